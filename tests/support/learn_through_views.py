"""Another library's PPO learns preset `fast`, the attacker alone, through a view: prints the shares of
fights that it won, in order of time, as JSON.

    python tests/support/learn_through_views.py brax|sb3

A program of its own, since the tests' environment compiles with little optimisation.
"""

import functools
import json
import sys

from dronecombat_jax.machine import backend


def with_brax() -> list[float]:
    """From exploring starts, evaluated from rest; a time-out is an end, as in `fast`."""
    backend.import_mjx()
    from brax.training.agents.ppo import networks as ppo_networks
    from brax.training.agents.ppo import train as ppo

    from dronecombat_jax.adapters.brax_env import CombatEnv, mend_brax, wrap
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.config import settings
    from dronecombat_jax.types import ATTACKER

    mend_brax()
    combat, wins, sizes = Combat(settings.load("fast", {})), [], (64, 64)
    env = CombatEnv(combat, ATTACKER, exploring=True)
    ppo.train(
        env, eval_env=CombatEnv(combat, ATTACKER), num_timesteps=4_000_000,
        wrap_env_fn=functools.partial(wrap, mask_time_outs=False),
        episode_length=env.episode_steps + 1, num_envs=256, unroll_length=24, batch_size=64,
        num_minibatches=8, num_updates_per_batch=5, num_eval_envs=128, num_evals=9,
        discounting=0.99, learning_rate=5e-4, entropy_cost=1e-3, reward_scaling=0.1,
        clipping_epsilon=0.2, max_grad_norm=1.0, normalize_observations=True, seed=0,
        network_factory=functools.partial(
            ppo_networks.make_ppo_networks,
            policy_hidden_layer_sizes=sizes,
            value_hidden_layer_sizes=sizes,
        ),
        progress_fn=lambda _, metrics: wins.append(float(metrics["eval/episode_win"])),
    )  # fmt: skip
    return wins


def with_sb3() -> list[float]:
    """From rest; of the last hundred fights while it learns."""
    import numpy as np
    import torch  # pyright: ignore[reportMissingImports]
    from stable_baselines3 import PPO  # pyright: ignore[reportMissingImports]
    from stable_baselines3.common.vec_env import (  # pyright: ignore[reportMissingImports]
        VecMonitor,
        VecNormalize,
    )

    from dronecombat_jax.adapters.gymnasium_env import CombatVectorEnv
    from dronecombat_jax.adapters.sb3_env import to_sb3
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.config import settings

    torch.set_num_threads(1)  # two wait for each other where others are busy
    combat, wins, steps = Combat(settings.load("fast", {})), [], 32
    view = CombatVectorEnv(combat, "attacker", None, 256, "SAME_STEP")
    env = VecNormalize(VecMonitor(to_sb3(view)), gamma=0.99)
    network = {"log_std_init": -0.5, "activation_fn": torch.nn.ELU, "net_arch": [64, 64]}
    model = PPO(
        "MlpPolicy", env, n_steps=steps, batch_size=1024, n_epochs=5, gamma=0.99,
        learning_rate=5e-4, seed=0, device="cpu", policy_kwargs=network,
    )  # fmt: skip
    for total in (4 * 256 * steps, 1_000_000, 1_000_000):
        model.learn(total, reset_num_timesteps=False)
        wins.append(float(np.mean(model.ep_success_buffer)))
    return wins


if __name__ == "__main__":
    backend.prepare("cpu")
    learn = {"brax": with_brax, "sb3": with_sb3}[sys.argv[1]]
    print(json.dumps(learn()))
