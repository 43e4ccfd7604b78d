"""Best responses by another learner: brax's PPO, through the package's view, against a frozen policy.

    python experiments/brax_response.py RUN --role defender --steps 20e6 --restarts 2
    python experiments/brax_response.py pilots:strong-defender-67 --preset responder

Does `dronecombat exploit` say something of the policy, or of our learner alone? Responders of brax's
PPO, one after the other, learn from the same starts against the same frozen policy, and the best is
chosen and counted in the same fights; the result, `RUN/exploit/defender-34-x2-brax.json`, has the
same form. brax's networks end in tanh and have their own scaling; sizes, discount and rollout are
the run's, what is left is brax's own or as in `tests/adapters/test_brax_learns.py`. A training that
is stopped begins anew.
"""

import argparse
import functools
import json
import sys
from collections.abc import Callable
from typing import Any

from dronecombat_jax.errors import UserError
from dronecombat_jax.machine import backend
from dronecombat_jax.runs.responders import POINTS, Plan, Wanted, plan

MINIBATCHES = 8


def main() -> int:
    """Read the flags, train, fight, write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", help="as of dronecombat exploit")
    parser.add_argument("--role", choices=("defender", "attacker"), default="defender")
    parser.add_argument("--steps", type=float, default=20e6, help="of each responder (%(default)s)")
    parser.add_argument("--restarts", type=int, default=2, help="responders (%(default)s)")
    parser.add_argument("--fights", type=int, default=1024, help="fresh ones (%(default)s)")
    parser.add_argument("--preset", default="", help="settings of the responders, as there")
    flags = parser.parse_args()
    try:
        wanted = Wanted(flags.run, flags.role, flags.steps, flags.restarts, flags.fights)
        planned = plan(wanted._replace(preset=flags.preset))
        backend.prepare("auto")
        print(respond(planned))
    except UserError as error:
        print(f"error: {error.message}", file=sys.stderr)
        return error.exit_code
    return 0


def respond(planned: Plan) -> str:
    """Train all responders, let them fight, write the result and its picture; returns one line."""
    import jax
    import numpy as np

    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.files.atomic import write_atomic
    from dronecombat_jax.report.exploit_figure import exploit_curve
    from dronecombat_jax.report.figures import save_figure
    from dronecombat_jax.runs.exploit import Point, about, best_so_far, flight, line, write_policy
    from dronecombat_jax.runs.opponents import read_named
    from dronecombat_jax.types import SIDES

    write_policy(planned)
    config, wanted = planned.config, planned.wanted
    combat, side = Combat(config), SIDES.index(wanted.role)
    guest = next(iter(read_named(config).cast(config.game).values()), None)
    frozen, shown = guest or (wanted.word.partition(":")[2], "")
    seeds = range(config.train.seed, config.train.seed + wanted.restarts)
    each = [trained(combat, side, frozen, shown, seed) for seed in seeds]
    make_policy = each[0][0]
    stacked = [
        Point(steps, jax.tree.map(lambda *leaves: np.stack(leaves), *parameters))
        for steps, *parameters in zip(
            each[0][1], *(parameters for _, _, parameters in each), strict=True
        )
    ]

    def responder(parameters: Any) -> Callable[..., Any]:
        act = make_policy(parameters, deterministic=True)
        return lambda state, seen, key: act(seen[:, 1 - side], key)[0]

    batch = min(256, wanted.fights)
    fly = flight(combat, side, frozen, responder, batch, shown)
    choice, fresh = jax.random.split(jax.random.key(wanted.seed))
    keys = list(jax.random.split(fresh, -(-wanted.fights // batch)))
    curve = best_so_far(fly, stacked, choice, keys, batch)
    for point in curve:
        point["seed"] += config.train.seed
    result = about(planned, config, stacked) | {"learner": "brax ppo", "choice_fights": batch}
    result |= {"fights": batch * len(keys), "curve": curve}
    file = planned.result.with_name(f"{planned.result.stem}-brax.json")
    file.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(file, json.dumps(result, indent=2) + "\n")
    save_figure(exploit_curve(result), file.with_suffix(".png"))
    return f"brax's ppo: {line(result)}\nwritten to {file}"


def trained(
    combat: Any, side: int, frozen: Any, shown: str, seed: int
) -> tuple[Any, list[int], list[Any]]:
    """One responder: what makes a policy of parameters, and steps and parameters along its training.
    `shown`: what `frozen` sees, where that is not the game's own.
    """
    import jax
    from brax.training.agents.ppo import networks as ppo_networks
    from brax.training.agents.ppo import train as ppo

    from dronecombat_jax.adapters.brax_env import CombatEnv, mend_brax, wrap
    from dronecombat_jax.arena.match import policy_pilot
    from dronecombat_jax.combat.scripted import build_pilot
    from dronecombat_jax.combat.sensors import view_of

    config = combat.config
    learn, train = config.learn, config.train
    pilot = (
        build_pilot(frozen, config, combat.scene, side)
        if isinstance(frozen, str)
        else policy_pilot(learn, frozen, side, view=view_of(config, shown))
    )
    env = CombatEnv(combat, 1 - side, pilot, exploring=True)
    networks = functools.partial(
        ppo_networks.make_ppo_networks,
        policy_hidden_layer_sizes=learn.hidden_sizes,
        value_hidden_layer_sizes=learn.hidden_sizes,
    )
    wrapped: Any = functools.partial(wrap, mask_time_outs=learn.bootstrap_timeout)
    made, steps, parameters = [], [], []

    def keep(step: int, make_policy: Any, current: Any) -> None:
        made[:] = [make_policy]
        if step:  # not the untrained one
            steps.append(int(step))
            parameters.append(jax.device_get(current[:2]))
            print(f"seed {seed}: {step:,} steps", flush=True)

    mend_brax()
    envs = max(train.num_envs // MINIBATCHES, 1) * MINIBATCHES
    ppo.train(
        env, num_timesteps=train.total_steps, num_evals=POINTS + 1, run_evals=False, seed=seed,
        wrap_env_fn=wrapped,
        episode_length=env.episode_steps + 1, num_envs=envs, unroll_length=learn.rollout_steps,
        batch_size=envs // MINIBATCHES, num_minibatches=MINIBATCHES, num_updates_per_batch=learn.epochs,
        discounting=learn.discount, gae_lambda=learn.gae_lambda, learning_rate=learn.learning_rate,
        entropy_cost=1e-3, reward_scaling=0.1, clipping_epsilon=learn.clip_ratio,
        max_grad_norm=learn.max_grad_norm, normalize_observations=True, network_factory=networks,
        policy_params_fn=keep,
    )  # fmt: skip
    return made[0], steps, parameters


if __name__ == "__main__":
    sys.exit(main())
