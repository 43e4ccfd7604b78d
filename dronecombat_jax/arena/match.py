"""Batched fights between two pilots or teams of them, without learning: who wins, how, how fast.

A pilot is a pure function `(state [E, ...], observation [E, A, 35], key) -> action [E, 4]` that
flies one drone; trained policies and scripted pilots are the same to a match. A side of several
drones is flown by as many pilots, in their order. Many policies against many: `tournament`.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.scripted import Pilot, build_pilot
from dronecombat_jax.config.fields import Config, LearnConfig
from dronecombat_jax.learn.rollout import policy_mean
from dronecombat_jax.types import (
    ATTACKER,
    DEFENDER,
    Cause,
    EnvState,
    FightRecord,
    FightResult,
    Policy,
    Trajectory,
)

Team = Pilot | Sequence[Pilot]  # of one side, a pilot for each of its drones


def policy_pilot(learn: LearnConfig, policy: Policy, drone: int, stochastic: bool = False) -> Pilot:
    """Fly `policy` as `drone`, which in a duel is the role: its mean action or, `stochastic`, a
    random action.

    Its log-std is taken as it is: `policies.file.as_flown` puts it into its bounds.
    """

    def act(state: EnvState, observation: jax.Array, key: jax.Array) -> jax.Array:
        mean = policy_mean(learn, policy, observation[:, drone])
        if not stochastic:
            return mean
        return mean + jnp.exp(policy.log_std) * jax.random.normal(key, mean.shape)

    return act


def policy_team(
    config: Config, learn: LearnConfig, policy: Policy, role: int, stochastic: bool = False
) -> Sequence[Pilot]:
    """`policy` at the controls of every drone of the side `role`."""
    return [
        policy_pilot(learn, policy, drone, stochastic)
        for drone, side in enumerate(config.game.sides)
        if side == role
    ]


def scripted_team(combat: Combat, name: str, role: int) -> Sequence[Pilot]:
    """The scripted pilot `name` at the controls of every drone of the side `role`. UserError for an
    unknown one.
    """
    return [
        build_pilot(name, combat.config, combat.scene, role, drone)
        for drone, side in enumerate(combat.config.game.sides)
        if side == role
    ]


def start_fights(combat: Combat, key: jax.Array, num_fights: int) -> EnvState:
    """The start states [E, ...] of a match; the same key gives the same fights to every pair."""
    return jax.vmap(combat.spawn)(combat.start_numbers(key, (num_fights,)))


def fight(
    combat: Combat, defender: Team, attacker: Team, start: EnvState, key: jax.Array
) -> FightResult:
    """Fight all of `start` [E, ...] to the end; stops when the last one has ended."""

    def running(carry: tuple) -> jax.Array:
        return jnp.any(carry[1].cause == Cause.NONE)

    def step_on(carry: tuple) -> tuple:
        state, result, step = carry
        state, result, _ = advance(
            combat, defender, attacker, state, result, jax.random.fold_in(key, step)
        )
        return state, result, step + 1

    carry = (start, no_result(start), jnp.zeros((), jnp.int32))
    return jax.lax.while_loop(running, step_on, carry)[1]


def record(
    combat: Combat, defender: Team, attacker: Team, start: EnvState, key: jax.Array
) -> FightRecord:
    """Like `fight`, keeping every step: `episode_steps` of them."""

    def step_on(carry: tuple, step: jax.Array) -> tuple:
        state, result = carry
        state, result, action = advance(
            combat, defender, attacker, state, result, jax.random.fold_in(key, step)
        )
        return (state, result), (state.qpos, state.qvel, jnp.clip(action, -1.0, 1.0))

    steps = jnp.arange(combat.config.game.episode_steps)
    (_, result), (qpos, qvel, action) = jax.lax.scan(step_on, (start, no_result(start)), steps)
    return FightRecord(qpos, qvel, action, start, result)


def advance(
    combat: Combat,
    defender: Team,
    attacker: Team,
    state: EnvState,
    result: FightResult,
    key: jax.Array,
) -> tuple[EnvState, FightResult, jax.Array]:
    """Fly one control step of every fight `state` [E, ...] whose `result` [E, ...] has no cause
    yet; the rest stand still.

    Also returns the actions [E, A, 4] that the pilots gave. A fight's outcome does not depend on
    the others beside it.
    """
    observation = jax.vmap(combat.observe)(state)
    keys = jax.random.split(key)
    action = jnp.stack(
        [
            pilot(state, observation, mate_key(keys[role], number))
            for role, side in ((DEFENDER, defender), (ATTACKER, attacker))
            for number, pilot in enumerate([side] if callable(side) else side)
        ],
        axis=1,
    )
    after, output = jax.vmap(combat.step)(state, action)
    on = result.cause == Cause.NONE
    keep = lambda new, old: jnp.where(on.reshape(-1, *[1] * (new.ndim - 1)), new, old)
    now = FightResult(output.cause, result.steps + 1, after.crashed & ~combat.absent)
    return jax.tree.map(keep, after, state), jax.tree.map(keep, now, result), action


def mate_key(key: jax.Array, number: int) -> jax.Array:
    """The key of a team's drone `number` for a step; the first has the side's own."""
    return jax.random.fold_in(key, number) if number else key


def no_result(start: EnvState) -> FightResult:
    """The result [E, ...] of fights that have not ended."""
    return FightResult(
        jnp.zeros_like(start.clock), jnp.zeros_like(start.clock), jnp.zeros_like(start.down)
    )


def trajectory(combat: Combat, fights: FightRecord, index: int) -> Trajectory:
    """One fight of a record, cut at its end, its start state first."""
    steps = int(fights.result.steps[index])
    first = lambda start, path: np.concatenate(
        [np.asarray(start)[index][None], np.asarray(path)[:steps, index]]
    )
    action = np.asarray(fights.action)[:steps, index]
    return Trajectory(
        time=np.arange(steps + 1) * combat.config.control_dt,
        qpos=first(fights.start.qpos, fights.qpos),
        qvel=first(fights.start.qvel, fights.qvel),
        action=np.concatenate([action, action[-1:]]),
        target=np.asarray(fights.start.target)[index],
        cause=int(fights.result.cause[index]),
        control_dt=combat.config.control_dt,
    )
