"""Peer: brax's PPO on our brax view, the attacker against a frozen, untrained defender: one
learner.

    python -m benchmarks.peers.brax_ppo      # asked for its turns on stdin, see `turns`

brax wants mini-batches x sequences to be a multiple of the environments: 996 instead of 1000, so
that six mini-batches of 166 sequences of 24 steps are one rollout. The other settings are those of
our `LearnConfig` where brax has them.
"""

import functools

from dronecombat_jax.machine import backend


def main() -> None:
    """Train for ever, in turns."""
    backend.prepare("cpu")
    backend.import_mjx()  # brax imports it, and lets it print to stdout
    import jax
    from brax.training.agents.ppo import networks, train
    from flax import linen

    from benchmarks.peers.turns import Turns
    from dronecombat_jax.adapters.brax_env import CombatEnv, mend_brax, wrap
    from dronecombat_jax.arena.match import policy_pilot
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.config.fields import Config
    from dronecombat_jax.learn.ippo import init_learner
    from dronecombat_jax.learn.rollout import policy_of
    from dronecombat_jax.types import ATTACKER, DEFENDER

    config = Config()
    learn = config.learn
    frozen = policy_of(init_learner(jax.random.key(1), learn))
    pilot = policy_pilot(learn, frozen, DEFENDER, stochastic=True)
    assert callable(pilot)  # without memory
    env = CombatEnv(Combat(config), ATTACKER, pilot)
    sequences = config.train.num_envs // learn.minibatches
    rollout = sequences * learn.minibatches * learn.rollout_steps
    turns = Turns(rollout)
    orthogonal = {"scale": learn.hidden_gain}
    mend_brax()
    train.train(
        env,
        num_timesteps=10**6 * rollout,
        num_evals=10**6 + 1,
        run_evals=False,
        progress_fn=lambda step, metrics: turns.done(),
        episode_length=env.episode_steps,
        wrap_env_fn=functools.partial(wrap, mask_time_outs=False),  # pyright: ignore[reportArgumentType]
        bootstrap_on_timeout=learn.bootstrap_timeout,
        num_envs=sequences * learn.minibatches,
        unroll_length=learn.rollout_steps,
        batch_size=sequences,
        num_minibatches=learn.minibatches,
        num_updates_per_batch=learn.epochs,
        learning_rate=learn.learning_rate,
        learning_rate_schedule="ADAPTIVE_KL",
        desired_kl=learn.kl_target,
        entropy_cost=learn.entropy_scale,
        discounting=learn.discount,
        gae_lambda=learn.gae_lambda,
        clipping_epsilon=learn.clip_ratio,
        clipping_epsilon_value=learn.clip_value,
        vf_loss_coefficient=2.0 * learn.value_loss_scale,  # brax halves it
        max_grad_norm=learn.max_grad_norm,
        normalize_observations=True,
        network_factory=functools.partial(
            networks.make_ppo_networks,
            policy_hidden_layer_sizes=learn.hidden_sizes,
            value_hidden_layer_sizes=learn.hidden_sizes,
            activation=linen.elu,
            distribution_type="normal",
            noise_std_type="log",
            policy_network_kernel_init_fn=jax.nn.initializers.orthogonal,
            policy_network_kernel_init_kwargs=orthogonal,
            value_network_kernel_init_fn=jax.nn.initializers.orthogonal,
            value_network_kernel_init_kwargs=orthogonal,
        ),
    )


if __name__ == "__main__":
    main()
