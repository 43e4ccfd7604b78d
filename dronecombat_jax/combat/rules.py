"""The rules: which events a control step contains, what ends the fight and who has won.

Plain arrays of one fight; no simulator and no reward in here.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from dronecombat_jax.config.fields import GameConfig
from dronecombat_jax.config.sides import DUEL, Sides, team
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause, Outcome


class Events(NamedTuple):
    """What happened in one control step of one fight; each [] or [A] bool."""

    intercept: jax.Array  # [] a defender struck an attacker
    reached: jax.Array  # [] an attacker reached the target
    crashed: jax.Array  # [A] went down in this step
    down: jax.Array  # [A] lies on the ground after this step, or was absent from the start
    timeout: jax.Array  # []
    # Who did it: [D, M] bool, which of D defenders struck which of M attackers, and [M] bool. None:
    # the one drone of the side.
    strikes: jax.Array | None = None
    arrived: jax.Array | None = None


def closest_approach(start: jax.Array, end: jax.Array) -> jax.Array:
    """Smallest distance to the origin along the segment `start` -> `end`, both [..., 3] m."""
    delta = end - start
    length2 = jnp.sum(delta * delta, axis=-1)
    along = jnp.clip(-jnp.sum(start * delta, axis=-1) / jnp.maximum(length2, 1e-12), 0.0, 1.0)
    return jnp.linalg.norm(start + along[..., None] * delta, axis=-1)


def detect(
    game: GameConfig,
    before: jax.Array,
    after: jax.Array,
    target: jax.Array,
    down: jax.Array,
    clock: jax.Array,
    margin: jax.Array | float = 0.0,
) -> Events:
    """Find the events of a control step.

    `before`, `after` [A, 3] m: positions at its ends; `target` [3] m; `down` [A] bool: down before
    the step, so neither strikes, is struck nor crashes again; `clock` []: steps flown, this one
    included; `margin` [] m: added to the intercept radius.
    """
    if not game.swept_events:
        before = after
    defence, attack = teams(game)
    apart = lambda place: place[defence][:, None] - place[attack][None]
    near = closest_approach(apart(before), apart(after)) < game.intercept_radius + margin
    strikes = near & ~down[defence][:, None] & ~down[attack]
    miss = closest_approach(before[attack] - target, after[attack] - target)
    arrived = (miss < game.reach_radius) & ~down[attack]
    crashed = (after[:, 2] < game.crash_altitude) & ~down
    return Events(
        intercept=jnp.any(strikes),
        reached=jnp.any(arrived),
        crashed=crashed,
        down=down | crashed,
        timeout=clock >= game.episode_steps,
        strikes=strikes,
        arrived=arrived,
    )


def judge(game: GameConfig, events: Events) -> jax.Array:
    """The `Cause` [] int32 that ends the fight in this step, or NONE; the first of simultaneous
    events counts.

    A side has lost when none of its drones flies any more: the attackers to an interception where
    one of them was struck in this step, else to a crash. An attacker that is struck reaches nothing.
    """
    defence, attack = teams(game)
    taken, struck = taken_out(game, events), struck_out(game, events)
    gone, going = events.down | struck, events.crashed | struck
    arrived = events.reached if events.arrived is None else events.arrived & ~taken
    wiped = lambda side: jnp.all(gone[side]) & jnp.any(going[side])
    defender_crash, attacker_crash = wiped(defence), wiped(attack)
    both_crash = defender_crash & attacker_crash
    if game.crash_rule == "out":  # the attackers fly on alone, and fail with their own crash
        defender_crash = jnp.zeros_like(defender_crash)
    if game.crash_rule == "grounded":
        # the fight lasts until both lie there
        both_crash = jnp.all(events.down)
        defender_crash = attacker_crash = jnp.zeros_like(defender_crash)
    ordered = [
        (jnp.any(taken) & jnp.all(gone[attack]), Cause.INTERCEPT),
        (jnp.any(arrived), Cause.REACHED),
        (both_crash, Cause.BOTH_CRASH),
        (defender_crash, Cause.DEFENDER_CRASH),
        (attacker_crash, Cause.ATTACKER_CRASH),
        (events.timeout, Cause.TIMEOUT),
    ]
    cause = jnp.asarray(Cause.NONE, jnp.int32)
    for happened, name in reversed(ordered):
        cause = jnp.where(happened, jnp.int32(name), cause)
    return cause


def teams(game: GameConfig) -> tuple[slice, slice]:
    """The drones of the defender's and of the attacker's side."""
    return team(game.sides, DEFENDER), team(game.sides, ATTACKER)


def taken_out(game: GameConfig, events: Events) -> jax.Array:
    """Which attackers were struck in this step, [M] bool."""
    if events.strikes is None:
        return events.intercept.reshape(1)
    return jnp.any(events.strikes, axis=0)


def struck_out(game: GameConfig, events: Events) -> jax.Array:
    """Who goes down by a strike in this step, [A] bool: the attacker that is struck, and under
    `game.striker_down` the defender that struck.
    """
    taken, strikes = taken_out(game, events), events.strikes
    strikers = jnp.zeros(game.defenders, bool)
    if game.striker_down and strikes is not None:
        strikers = jnp.any(strikes, axis=1)
    return jnp.concatenate([strikers, taken])


def forfeit(invalid: jax.Array, sides: Sides = DUEL) -> jax.Array:
    """The `Cause` [] int32 by which the sides that gave an `invalid` [A] action lose the fight;
    NONE where none did.
    """
    defender, attacker = (jnp.any(invalid[team(sides, side)]) for side in (DEFENDER, ATTACKER))
    single = jnp.where(attacker, jnp.int32(Cause.ATTACKER_INVALID), jnp.int32(Cause.NONE))
    other = jnp.where(attacker, jnp.int32(Cause.BOTH_INVALID), jnp.int32(Cause.DEFENDER_INVALID))
    return jnp.where(defender, other, single)


def timeout_decides(game: GameConfig) -> bool:
    """Whether running out of time decides the fight (then it terminates rather than truncates)."""
    return game.timeout_rule == "defender"


def outcome_table(game: GameConfig) -> tuple[Outcome, ...]:
    """Who has won, indexed by `Cause`."""
    table = {
        Cause.INTERCEPT: Outcome.DEFENDER,
        Cause.REACHED: Outcome.ATTACKER,
        Cause.DEFENDER_CRASH: Outcome.ATTACKER,
        Cause.ATTACKER_CRASH: Outcome.DEFENDER,
        Cause.TIMEOUT: Outcome.DEFENDER if timeout_decides(game) else Outcome.DRAW,
        Cause.DEFENDER_INVALID: Outcome.ATTACKER,
        Cause.ATTACKER_INVALID: Outcome.DEFENDER,
    }
    return tuple(table.get(cause, Outcome.DRAW) for cause in Cause)
