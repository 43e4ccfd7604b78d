"""The training program: some iterations of IPPO for every seed, as one jitted function.

A run is a pure function of its configuration and seed. Every key is
fold_in(fold_in(key(seed), iteration), purpose), so a run resumed at any iteration is bit for bit
the run that was never stopped. The fights under way are part of the state; they are a few hundred
kilobytes, and resetting them at every chunk (`reset_at_chunk`) puts all environments in step: each
rollout then holds one phase of the fight only, and the policies forget the others.
"""

from collections.abc import Callable
from enum import IntEnum

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config import Config
from dronecombat_jax.learn.ippo import IterationKeys, init_learner, iterate
from dronecombat_jax.types import NUM_AGENTS, EnvState, IterationMetrics, TrainState


class Purpose(IntEnum):
    """What a key is for. Never renumber: it would change every run."""

    PARAMETERS = 0
    RESET = 1
    CLOCK = 2
    NOISE = 3
    SPAWN = 4
    SHUFFLE = 5


def init_state(combat: Combat) -> TrainState:
    """The state of a run before its first iteration; every leaf [S, ...]."""
    train = combat.config.train
    seeds = jnp.arange(train.seed, train.seed + train.num_seeds, dtype=jnp.uint32)

    def init_seed(seed: jax.Array) -> TrainState:
        keys = jax.random.split(_key(seed, jnp.zeros((), jnp.int32), Purpose.PARAMETERS), NUM_AGENTS)
        learner = lambda key: init_learner(key, combat.config.learn)
        return TrainState(
            learners=jax.vmap(learner)(keys),
            env=reset_fights(combat, seed, jnp.zeros((), jnp.int32)),
            seed=seed,
            iteration=jnp.zeros((), jnp.int32),
        )

    return jax.lax.map(init_seed, seeds)


def build_advance(combat: Combat, iterations: int) -> Callable[[TrainState], tuple[TrainState, IterationMetrics]]:
    """Return `advance(state) -> (state, metrics)`: `iterations` iterations for every seed.

    Leaves of the state are [S, ...], of the metrics [S, iterations, ...]. Not jitted here. Seeds run
    one after the other, so that each one's products stay plain matrix products and its numbers are
    those it has alone.
    """

    def one_iteration(state: TrainState, _: None) -> tuple[TrainState, IterationMetrics]:
        return advance_iteration(combat, state)

    def one_seed(state: TrainState) -> tuple[TrainState, IterationMetrics]:
        return jax.lax.scan(one_iteration, state, None, length=iterations)

    return lambda state: jax.lax.map(one_seed, state)


def advance_iteration(combat: Combat, state: TrainState) -> tuple[TrainState, IterationMetrics]:
    """One iteration of one seed: fly and learn, in the fights under way or, if so set, in new ones at a chunk's start."""
    config = combat.config
    env = state.env
    if config.warmup_chunks and config.game.scenario == "duel":
        # The warm-up is over: the defender, which stood at its start, enters the fights under way.
        enters = state.iteration == config.warmup_chunks * config.train.chunk_iterations
        env = env.replace(out=env.out & ~enters)
    if config.train.reset_at_chunk:
        starts_chunk = state.iteration % config.train.chunk_iterations == 0
        env = jax.lax.cond(starts_chunk, lambda: reset_fights(combat, state.seed, state.iteration), lambda: env)
    alone = attacker_alone(config, state.iteration)
    learners, env, metrics = iterate(
        combat,
        state.learners,
        env,
        IterationKeys(*(_key(state.seed, state.iteration, p) for p in (Purpose.NOISE, Purpose.SPAWN, Purpose.SHUFFLE))),
        learning=jnp.stack([~alone, jnp.ones_like(alone)]),
        absent_defender=alone,
    )
    return state.replace(learners=learners, env=env, iteration=state.iteration + 1), metrics


def attacker_alone(config: Config, iteration: jax.Array) -> jax.Array:
    """Whether the defender is absent in this iteration: always in `solo`, else during the warm-up."""
    warmup = config.warmup_chunks * config.train.chunk_iterations
    return (iteration < warmup) | (config.game.scenario == "solo")


def reset_fights(combat: Combat, seed: jax.Array, iteration: jax.Array) -> EnvState:
    """N fights about to start; their clocks are drawn so that time-outs do not come in waves."""
    config = combat.config
    num_envs = config.train.num_envs
    draws = combat.draw(_key(seed, iteration, Purpose.RESET), (num_envs,))
    env = jax.vmap(lambda draw: combat.spawn(draw, attacker_alone(config, iteration)))(draws)
    if not config.game.random_clock:
        return env
    key = _key(seed, iteration, Purpose.CLOCK)
    return env.replace(clock=jax.random.randint(key, (num_envs,), 0, config.game.episode_steps, jnp.int32))


def _key(seed: jax.Array, iteration: jax.Array, purpose: Purpose) -> jax.Array:
    return jax.random.fold_in(jax.random.fold_in(jax.random.key(seed), iteration), int(purpose))
