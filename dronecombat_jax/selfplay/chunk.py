"""The training program: some iterations of IPPO for every seed, as one jitted function.

A run is a pure function of its configuration and seed. Every key is
fold_in(fold_in(key(seed), iteration), purpose), so a run resumed at any iteration is bit for bit
the run that was never stopped. The fights under way are part of the state; they are a few hundred
kilobytes, and resetting them at every chunk (`reset_at_chunk`) puts all environments in step: each
rollout then holds one phase of the fight only, and the policies forget the others.
"""

from collections.abc import Callable
from enum import IntEnum
from typing import Any

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.games import game_of
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.opponents import learns
from dronecombat_jax.learn.algorithms import learn_from, new_learner, without
from dronecombat_jax.learn.memory import recall_size, with_recall
from dronecombat_jax.learn.rollout import Policies, collect
from dronecombat_jax.learn.settle import averaged, first_mean, settled
from dronecombat_jax.learn.sharding import along_environments
from dronecombat_jax.selfplay import opponents, tally
from dronecombat_jax.selfplay.mesh import over_seeds
from dronecombat_jax.selfplay.pool import (
    NOBODY,
    choose,
    chunk_rows,
    init_selfplay,
    lose_live,
    players,
    save_players,
)
from dronecombat_jax.selfplay.summary import count_causes, count_fights, summarize
from dronecombat_jax.types import (
    ATTACKER,
    DEFENDER,
    NUM_SIDES,
    EnvState,
    IterationMetrics,
    Outcome,
    TrainState,
    Transition,
)

NO_CAST: opponents.Cast = {}


class Purpose(IntEnum):
    """What a key is for. Never renumber: it would change every run."""

    PARAMETERS = 0
    RESET = 1
    CLOCK = 2
    NOISE = 3
    SPAWN = 4
    SHUFFLE = 5
    OPPONENT = 6


def init_state(combat: Combat) -> TrainState:
    """The state of a run before its first iteration; every leaf [S, ...]."""
    train = combat.config.train
    seeds = jnp.arange(train.seed, train.seed + train.num_seeds, dtype=jnp.uint32)

    def init_seed(seed: jax.Array) -> TrainState:
        key = _key(seed, jnp.zeros((), jnp.int32), Purpose.PARAMETERS)
        keys = jax.random.split(key, len(combat.config.pupils))
        # One after the other: under vmap jax 0.10.1 on two cores has hung here, in about one start
        # of a hundred.
        learners = jax.lax.map(lambda key: new_learner(key, combat.config), keys)
        return TrainState(
            learners=learners,
            env=reset_fights(combat, seed, jnp.zeros((), jnp.int32)),
            flown=tally.fresh(train.num_envs, len(combat.config.game.sides)),
            seed=seed,
            iteration=jnp.zeros((), jnp.int32),
            selfplay=init_selfplay(combat.config, learners),
            mean=first_mean(combat.config, learners),
        )

    return jax.lax.map(init_seed, seeds)


def build_advance(
    combat: Combat,
    iterations: int,
    mesh: jax.sharding.Mesh | None = None,
    cast: opponents.Cast = NO_CAST,
) -> Callable[[TrainState], tuple[TrainState, IterationMetrics]]:
    """Return `advance(state) -> (state, metrics)`: `iterations` iterations for every seed.

    Leaves of the state are [S, ...], of the metrics [S, iterations, ...]. Not jitted here. On a CPU
    seeds run one after the other, so that each one's products stay plain matrix products and its
    numbers are those it has alone; elsewhere they run side by side, since one alone cannot fill
    such a device, and agree with that to float order (`run.seeds_at_once`). With a `mesh`
    (`selfplay.mesh`) each row of devices runs its share. `cast`: the frozen policies of the table
    of opponents.
    """
    return _for_all_seeds(
        combat.config, lambda state: advance_iteration(combat, state, cast), iterations, mesh
    )


def build_flight(
    combat: Combat,
    iterations: int,
    mesh: jax.sharding.Mesh | None = None,
    cast: opponents.Cast = NO_CAST,
) -> Callable[[TrainState], tuple[TrainState, Transition]]:
    """Return a function like `advance` that flies and does not learn.

    The difference of both times is the time of learning. Instead of metrics the function returns
    the sums of what was collected, so that XLA leaves nothing out.
    """

    def fly(state: TrainState) -> tuple[TrainState, Transition]:
        env, rollout = _collect(combat, state, cast)
        return state.replace(env=env, iteration=state.iteration + 1), jax.tree.map(jnp.sum, rollout)

    return _for_all_seeds(combat.config, fly, iterations, mesh)


def _for_all_seeds(
    config: Config,
    single: Callable[[TrainState], tuple[TrainState, Any]],
    iterations: int,
    mesh: jax.sharding.Mesh | None,
) -> Callable[[TrainState], tuple[TrainState, Any]]:
    """`iterations` calls of `single`, an iteration of one seed, for every seed [S, ...]."""

    def one_seed(state: TrainState) -> tuple[TrainState, Any]:
        return jax.lax.scan(lambda state, _: single(state), state, None, length=iterations)

    at_once = config.run.seeds_at_once or (
        1 if jax.default_backend() == "cpu" else config.train.num_seeds
    )

    def all_seeds(state: TrainState) -> tuple[TrainState, Any]:
        batch = min(at_once, state.seed.shape[0])
        return jax.lax.map(one_seed, state, batch_size=batch if batch > 1 else None)

    return all_seeds if mesh is None else over_seeds(all_seeds, mesh)


def advance_iteration(
    combat: Combat, state: TrainState, cast: opponents.Cast = NO_CAST
) -> tuple[TrainState, IterationMetrics]:
    """One iteration of one seed: fly and learn, in the fights under way or, if so set, in new ones
    at a chunk's start. `cast`: the frozen policies of the table of opponents.
    """
    config = combat.config
    state = begin_chunk(combat, state)
    env, rollout = _collect(combat, state, cast)
    flown, at_each_step = tally.follow(
        state.flown, rollout, opponents.codes(config, state.selfplay)
    )
    shuffle = _key(state.seed, state.iteration, Purpose.SHUFFLE)
    learning = jnp.stack([~waits(config, state.iteration), jnp.ones((), bool)])
    if state.selfplay is not None:
        learning &= jnp.arange(NUM_SIDES) != state.selfplay.frozen
    together, at_their_steps = without(config.solo_envs, (rollout, at_each_step))
    if config.train.lead_limit < 1.0:
        learning &= ~rests(config, count_causes(together, at_their_steps), learning)
    learners, updates = learn_from(
        settled(config, state.iteration),
        state.learners,
        rollout,
        shuffle,
        learning,
        opponents.parts(config),
        config.game.sides,
    )
    selfplay, met = count_fights(config, state.selfplay, rollout, at_each_step)
    metrics = summarize(config, together, at_their_steps, updates, selfplay)._replace(met=met)
    mean, learners = averaged(config, state.mean, learners, state.iteration)
    state = state.replace(learners=learners, env=env, flown=flown, selfplay=selfplay, mean=mean)
    return state.replace(iteration=state.iteration + 1), metrics


def begin_chunk(combat: Combat, state: TrainState) -> TrainState:
    """At a chunk's start: save both players to the pools, draw who is met and, if so set, start all
    fights anew.
    """
    config = combat.config
    chunk = state.iteration // config.train.chunk_iterations
    starts = state.iteration % config.train.chunk_iterations == 0

    def begin(state: TrainState) -> TrainState:
        env, flown, learners, selfplay = state.env, state.flown, state.learners, state.selfplay
        if config.train.reset_at_chunk:
            env, flown = (
                reset_fights(combat, state.seed, state.iteration),
                tally.fresh(config.train.num_envs, len(combat.config.game.sides)),
            )
        if selfplay is not None:
            met = opponents.codes(config, selfplay)
            selfplay = save_players(config, selfplay, learners, chunk)
            selfplay = choose(
                config, selfplay, chunk, _key(state.seed, state.iteration, Purpose.OPPONENT)
            )
            env = _forgotten(env, met != opponents.codes(config, selfplay))
            if not config.selfplay.restore_live:
                learners = lose_live(config, learners, selfplay)
        return state.replace(env=env, flown=flown, learners=learners, selfplay=selfplay)

    if state.selfplay is None and not config.train.reset_at_chunk:
        return state
    return jax.lax.cond(starts, begin, lambda state: state, state)


def waits(config: Config, iteration: jax.Array) -> jax.Array:
    """Whether the defender does not learn in this iteration: always where it does not fly, else during the
    attacker's head start.
    """
    head_start = config.head_start_chunks * config.train.chunk_iterations
    return (iteration < head_start) | (not game_of(config).flies[DEFENDER])


def rests(config: Config, causes: jax.Array, learning: jax.Array) -> jax.Array:
    """Which sides do not learn since they are too far ahead, [..., 2] bool, while the other side is
    `learning` [..., 2] (`train.lead_limit`); `causes` [..., len(Cause)] int32 of an iteration's fights.
    """
    causes, learning = jnp.asarray(causes), jnp.asarray(learning)  # one rounding, also for records
    winners = jnp.asarray(outcome_table(config.game))
    sides = ((DEFENDER, Outcome.DEFENDER), (ATTACKER, Outcome.ATTACKER))
    limit = config.train.lead_limit * jnp.sum(causes, axis=-1)
    ahead = [jnp.sum(causes, axis=-1, where=winners == outcome) > limit for _, outcome in sides]
    behind = [learning[..., 1 - side] & learns(config, 1 - side) for side, _ in sides]
    return jnp.stack(ahead, axis=-1) & jnp.stack(behind, axis=-1)


def reset_fights(combat: Combat, seed: jax.Array, iteration: jax.Array) -> EnvState:
    """N fights about to start; their clocks are drawn so that time-outs do not come in waves."""
    config = combat.config
    num_envs = config.train.num_envs
    numbers = combat.exploring_numbers(_key(seed, iteration, Purpose.RESET), (num_envs,))
    env = jax.vmap(combat.explore)(numbers, jnp.arange(num_envs) < config.solo_envs)
    env = with_recall(env, recall_size(config))
    if not config.game.random_clock:
        return env
    key = _key(seed, iteration, Purpose.CLOCK)
    return env.replace(
        clock=jax.random.randint(key, (num_envs,), 0, config.game.episode_steps, jnp.int32)
    )


def _forgotten(env: EnvState, changed: jax.Array) -> EnvState:
    """The fights `env` under way; where others meet from now on, `changed` [N], none remembers what
    came before.
    """
    if env.recall is None:
        return env
    return env.replace(recall=jnp.where(changed[:, None, None], 0.0, env.recall))


def _collect(
    combat: Combat, state: TrainState, cast: opponents.Cast
) -> tuple[EnvState, Transition]:
    """Collect a rollout of the players of this chunk. A policy for each environment is costly:
    chunks of live players do without.
    """
    config = combat.config
    noise, spawn = (
        _key(state.seed, state.iteration, purpose) for purpose in (Purpose.NOISE, Purpose.SPAWN)
    )

    def fly(policies: Policies) -> tuple[EnvState, Transition]:
        env, rollout = collect(
            combat, policies, along_environments(state.env, axis=0), noise, spawn
        )
        return along_environments(env, axis=0), along_environments(rollout, axis=1)

    policies = opponents.seats(combat, state.learners, state.selfplay, cast)
    whole = config.selfplay.scope == "chunk" or not chunk_rows(config)
    if state.selfplay is None or whole:
        return fly(policies)
    live = opponents.of_drones(config, players(config, state.learners, None))
    return jax.lax.cond(state.selfplay.frozen == NOBODY, lambda: fly(live), lambda: fly(policies))


def _key(seed: jax.Array, iteration: jax.Array, purpose: Purpose) -> jax.Array:
    return jax.random.fold_in(jax.random.fold_in(jax.random.key(seed), iteration), int(purpose))
