"""The rules: which events a control step contains, what ends the fight and who has won.

Plain arrays of one fight; no simulator and no reward in here.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from dronecombat_jax.config.fields import GameConfig
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause, Outcome


class Events(NamedTuple):
    """What happened in one control step of one fight; each [] or [A] bool."""

    intercept: jax.Array  # []
    reached: jax.Array  # []
    crashed: jax.Array  # [A] went down in this step
    down: jax.Array  # [A] lies on the ground after this step, or was absent from the start
    timeout: jax.Array  # []


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
) -> Events:
    """Find the events of a control step.

    `before`, `after` [A, 3] m: positions at its ends; `target` [3] m; `down` [A] bool: down before
    the step, so neither strikes, is struck nor crashes again; `clock` []: steps flown, this one
    included.
    """
    if not game.swept_events:
        before = after
    gap = closest_approach(before[DEFENDER] - before[ATTACKER], after[DEFENDER] - after[ATTACKER])
    miss = closest_approach(before[ATTACKER] - target, after[ATTACKER] - target)
    crashed = (after[:, 2] < game.crash_altitude) & ~down
    return Events(
        intercept=(gap < game.intercept_radius) & ~jnp.any(down),
        reached=(miss < game.reach_radius) & ~down[ATTACKER],
        crashed=crashed,
        down=down | crashed,
        timeout=clock >= game.episode_steps,
    )


def judge(game: GameConfig, events: Events) -> jax.Array:
    """The `Cause` [] int32 that ends the fight in this step, or NONE; the first of simultaneous
    events counts.
    """
    defender_crash, attacker_crash = events.crashed[DEFENDER], events.crashed[ATTACKER]
    both_crash = defender_crash & attacker_crash
    if game.crash_rule == "out":  # the attacker flies on alone, and fails with its own crash
        defender_crash = jnp.zeros_like(defender_crash)
    if game.crash_rule == "grounded":
        # the fight lasts until both lie there
        both_crash = jnp.all(events.down)
        defender_crash = attacker_crash = jnp.zeros_like(defender_crash)
    ordered = [
        (events.intercept, Cause.INTERCEPT),
        (events.reached, Cause.REACHED),
        (both_crash, Cause.BOTH_CRASH),
        (defender_crash, Cause.DEFENDER_CRASH),
        (attacker_crash, Cause.ATTACKER_CRASH),
        (events.timeout, Cause.TIMEOUT),
    ]
    cause = jnp.asarray(Cause.NONE, jnp.int32)
    for happened, name in reversed(ordered):
        cause = jnp.where(happened, jnp.int32(name), cause)
    return cause


def forfeit(invalid: jax.Array) -> jax.Array:
    """The `Cause` [] int32 by which the sides that gave an `invalid` [A] action lose the fight;
    NONE where none did.
    """
    defender, attacker = invalid[DEFENDER], invalid[ATTACKER]
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
