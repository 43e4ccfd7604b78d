"""Peer: IPPO in the shape of purejaxrl's single-file PPO, with the full `mjx.Data` in the scan's
carry (`full_data`).

    python -m benchmarks.peers.purejaxrl_ippo      # asked for its turns on stdin, see `turns`

One scan over environment steps with the key in the carry, one for the advantages, one over shuffled
mini-batches; flax modules and optax train states. Two learners where purejaxrl has one; the
settings are those of our `LearnConfig`.
"""

from typing import Any, NamedTuple

from dronecombat_jax.machine import backend

backend.prepare("cpu")

import flax.linen as nn  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import optax  # noqa: E402
from flax.training.train_state import TrainState  # noqa: E402

from benchmarks.peers.full_data import FullCombat  # noqa: E402
from benchmarks.peers.turns import Turns  # noqa: E402
from dronecombat_jax.combat.env import Combat  # noqa: E402
from dronecombat_jax.config.fields import Config, LearnConfig  # noqa: E402
from dronecombat_jax.learn.networks import gaussian_entropy, gaussian_log_prob  # noqa: E402
from dronecombat_jax.learn.normalize import init_scaler, normalize, update_scaler  # noqa: E402
from dronecombat_jax.learn.ppo import adapt_learning_rate  # noqa: E402
from dronecombat_jax.types import ACTION_SIZE, OBSERVATION_SIZE  # noqa: E402

AGENTS = (0, 1)


class Transition(NamedTuple):
    """One agent's part of a rollout, [T, N, ...]."""

    done: jax.Array
    action: jax.Array
    value: jax.Array
    reward: jax.Array
    log_prob: jax.Array
    obs: jax.Array  # normalised


class ActorCritic(nn.Module):
    """Separate policy and value networks: mean [4], log-std [4], value []."""

    hidden_sizes: tuple[int, ...]

    @nn.compact
    def __call__(self, x: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        mean, value = self.mlp(x, ACTION_SIZE), self.mlp(x, 1)[..., 0]
        return mean, self.param("log_std", nn.initializers.zeros, (ACTION_SIZE,)), value

    def mlp(self, x: jax.Array, output_size: int) -> jax.Array:
        dense = lambda size: nn.Dense(size, kernel_init=nn.initializers.orthogonal(2.0**0.5))
        for size in self.hidden_sizes:
            x = nn.elu(dense(size)(x))
        return dense(output_size)(x)


def make_train(config: Config, combat: Combat) -> tuple[Any, Any]:
    """`init(rng) -> runner` and `update(runner) -> runner`: one rollout and its epochs."""
    learn, num_envs = config.learn, config.train.num_envs
    env, network = FullCombat(combat), ActorCritic(learn.hidden_sizes)

    def init(rng: jax.Array):
        rng, *rngs = jax.random.split(rng, 4)
        tx = optax.chain(
            optax.clip_by_global_norm(learn.max_grad_norm),
            optax.inject_hyperparams(optax.adam)(learning_rate=learn.learning_rate),
        )
        states = tuple(
            TrainState.create(
                apply_fn=network.apply,
                params=network.init(rngs[agent], jnp.zeros(OBSERVATION_SIZE)),
                tx=tx,
            )
            for agent in AGENTS
        )
        obs, env_state = jax.vmap(env.reset)(jax.random.split(rngs[2], num_envs))
        clock = jax.random.randint(rng, (num_envs,), 0, config.game.episode_steps, jnp.int32)
        return states, init_scaler((OBSERVATION_SIZE,)), env_state.replace(clock=clock), obs, rng

    def update(runner):
        def env_step(runner, _):
            states, scaler, env_state, last_obs, rng = runner
            rng, step_rng, *rngs = jax.random.split(rng, 4)
            obs = normalize(scaler, last_obs)
            flown = [act(state, obs, key) for state, key in zip(states, rngs, strict=True)]
            action = jnp.stack([action for action, _, _ in flown], axis=1)
            step_rngs = jax.random.split(step_rng, num_envs)
            next_obs, env_state, reward, done = jax.vmap(env.step)(step_rngs, env_state, action)
            transition = tuple(
                Transition(done, action, value, reward[:, agent], log_prob, obs)
                for agent, (action, log_prob, value) in enumerate(flown)
            )
            return (states, scaler, env_state, next_obs, rng), (transition, last_obs)

        runner, (transitions, seen) = jax.lax.scan(env_step, runner, None, learn.rollout_steps)
        states, scaler, env_state, last_obs, rng = runner
        rng, *rngs = jax.random.split(rng, 3)
        last = normalize(scaler, last_obs)
        states = tuple(
            learn_agent(learn, state, transition, last, key)
            for state, transition, key in zip(states, transitions, rngs, strict=True)
        )
        return (
            states,
            update_scaler(scaler, seen, jnp.ones(seen.shape[:-1])),
            env_state,
            last_obs,
            rng,
        )

    return init, update


def act(
    state: TrainState, obs: jax.Array, rng: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Action, log-probability and value for normalised observations [N, 35]."""
    mean, log_std, value = state.apply_fn(state.params, obs)
    action = mean + jnp.exp(log_std) * jax.random.normal(rng, mean.shape)
    return action, gaussian_log_prob(action, mean, log_std), value


def advantages(learn: LearnConfig, batch: Transition, last_value: jax.Array) -> jax.Array:
    """Generalised advantages [T, N]."""

    def step(carry, transition):
        gae, next_value = carry
        alive = 1.0 - transition.done
        delta = transition.reward + learn.discount * next_value * alive - transition.value
        gae = delta + learn.discount * learn.gae_lambda * alive * gae
        return (gae, transition.value), gae

    return jax.lax.scan(step, (jnp.zeros_like(last_value), last_value), batch, reverse=True)[1]


def learn_agent(
    learn: LearnConfig, state: TrainState, batch: Transition, last_obs: jax.Array, rng: jax.Array
):
    """All epochs of one agent."""
    gae = advantages(learn, batch, state.apply_fn(state.params, last_obs)[2])
    flat = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), (batch, gae, gae + batch.value))
    size = flat[1].shape[0]

    def update_minibatch(state, minibatch):
        (_, kl), grads = jax.value_and_grad(loss, argnums=1, has_aux=True)(
            learn, state.params, state, *minibatch
        )
        return state.apply_gradients(grads=grads), kl

    def update_epoch(state, rng):
        order = jax.random.permutation(rng, size)
        cut = lambda x: jnp.take(x, order, axis=0).reshape(learn.minibatches, -1, *x.shape[1:])
        state, kl = jax.lax.scan(update_minibatch, state, jax.tree.map(cut, flat))
        hyper = state.opt_state[1].hyperparams
        rate = adapt_learning_rate(learn, hyper["learning_rate"], jnp.mean(kl))
        adam = state.opt_state[1]._replace(hyperparams=hyper | {"learning_rate": rate})
        return state.replace(opt_state=(state.opt_state[0], adam)), None

    return jax.lax.scan(update_epoch, state, jax.random.split(rng, learn.epochs))[0]


def loss(
    learn: LearnConfig,
    params,
    state: TrainState,
    batch: Transition,
    gae: jax.Array,
    target: jax.Array,
):
    """Clipped losses of one mini-batch [B, ...]; also the approximate KL."""
    mean, log_std, value = state.apply_fn(params, batch.obs)
    log_ratio = gaussian_log_prob(batch.action, mean, log_std) - batch.log_prob
    ratio = jnp.exp(log_ratio)
    gae = (gae - gae.mean()) / (gae.std() + 1e-8)
    clipped = jnp.clip(ratio, 1.0 - learn.clip_ratio, 1.0 + learn.clip_ratio)
    policy_loss = -jnp.mean(jnp.minimum(ratio * gae, clipped * gae))
    near = batch.value + jnp.clip(value - batch.value, -learn.clip_value, learn.clip_value)
    value_loss = jnp.mean(jnp.maximum((value - target) ** 2, (near - target) ** 2))
    total = (
        policy_loss
        + learn.value_loss_scale * value_loss
        - learn.entropy_scale * gaussian_entropy(log_std).mean()
    )
    return total, jnp.mean(ratio - 1.0 - log_ratio)


def main() -> None:
    """Train for ever, in turns."""
    config = Config()
    init, update = make_train(config, Combat(config))
    runner = jax.jit(init)(jax.random.PRNGKey(0))
    program = jax.jit(update, donate_argnums=0)
    turns = Turns(config.steps_per_iteration)
    while True:
        runner = jax.block_until_ready(program(runner))
        turns.done()


if __name__ == "__main__":
    main()
