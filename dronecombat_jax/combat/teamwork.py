"""Scripted teams: laws by which each drone of a side takes its team mates into account.

A law sees the whole fight and answers for one drone. Nothing is remembered and nothing is random:
team mates that compute the same from the same state agree without a word. What does not live here:
the laws of single drones (`guidance`), the pilots and their names (`scripted`).
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from dronecombat_jax.combat.autopilot import Airframe
from dronecombat_jax.combat.guidance import (
    Situation,
    dash,
    dot,
    proportional_navigation,
    rush,
    situation_of,
    time_to_go,
    unit,
)
from dronecombat_jax.types import ATTACKER, DEFENDER, Drones

PINCER_ANGLE = np.pi / 4  # rad from the straight way to the target, of the outermost attackers
PINCER_END = 2.5  # m before the target they fly straight; from twice that on they turn in
DECOY_DISTANCE = 2.0  # m to a defender, within which an attacker turns away
OUT = 1e3  # s to go, or m away: between drones of which one is down


class Field(NamedTuple):
    """E fights as one side sees them; own team and other team [E, D, ...], [E, M, ...]."""

    own: Drones
    others: Drones
    own_fly: jax.Array  # [E, D] bool
    others_fly: jax.Array  # [E, M] bool
    target: jax.Array  # [E, 3] m
    time: jax.Array  # [E] s since the start


# (airframe, field, number of the drone in its team) -> wanted acceleration [E, 3] m/s^2, world frame
TeamLaw = Callable[[Airframe, Field, int], jax.Array]


def assigned_navigation(body: Airframe, field: Field, number: int) -> jax.Array:
    """Defenders share the attackers so that the sum of the times to go is least, each flies
    `proportional_navigation` against its own; who is left over takes the one it reaches first.
    """
    cost = times_to_go(body, field)
    return proportional_navigation(body, situation(field, number, minded(cost)[:, number]))


def pincer(body: Airframe, field: Field, number: int) -> jax.Array:
    """Attackers come from several sides: each flies at an angle to its way to the target, the team
    spread evenly from PINCER_ANGLE to the left to as much to the right, and turns in near it.

    A constant angle b to the way is a logarithmic spiral: from r0 to r1 m, the side from which the
    target is approached turns by tan(b) ln(r0 / r1). One attacker alone flies straight, as `dash`.
    """
    count = field.own.position.shape[1]
    angle = 0.0 if count == 1 else PINCER_ANGLE * (1.0 - 2.0 * number / (count - 1))
    way = field.target - field.own.position[:, number]
    far = jnp.linalg.norm(way, axis=-1)
    turn = angle * jnp.clip((far - PINCER_END) / PINCER_END, 0.0, 1.0)
    cosine, sine = jnp.cos(turn), jnp.sin(turn)
    x, y, z = way[:, 0], way[:, 1], way[:, 2]
    turned = jnp.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=-1)
    return rush(body, field.own.velocity[:, number], turned)


def decoy(body: Airframe, field: Field, number: int) -> jax.Array:
    """All dash at the target; while two or more fly, the one that a defender has come nearest to, to
    DECOY_DISTANCE or less, turns away from that defender over ground, and draws it along.

    Of team mates at the same distance the first turns away.
    """
    gaps = _where_flying(field, jnp.linalg.norm(_ways(field.own, field.others), axis=-1))
    nearest = jnp.min(gaps, axis=2)  # [E, D]
    chased = (jnp.argmin(nearest, axis=1) == number) & (nearest[:, number] <= DECOY_DISTANCE)
    draws = chased & (jnp.sum(field.own_fly, axis=1) > 1)
    now = situation(field, number, jnp.argmin(gaps[:, number], axis=1))
    away = (now.position - now.other_position).at[:, 2].set(0.0)
    return jnp.where(draws[:, None], rush(body, now.velocity, away), dash(body, now))


TEAMWORK: dict[int, dict[str, TeamLaw]] = {
    DEFENDER: {"assigned_navigation": assigned_navigation},
    ATTACKER: {"pincer": pincer, "decoy": decoy},
}


def times_to_go(body: Airframe, field: Field) -> jax.Array:
    """Seconds [E, D, M] in which each drone meets each opponent under full thrust; OUT where one of
    the two is down.
    """
    sight = _ways(field.own, field.others)
    along = unit(sight)
    relative = field.others.velocity[:, None] - field.own.velocity[:, :, None]
    closing = -dot(relative, along)[..., 0]
    distance = jnp.linalg.norm(sight, axis=-1)
    return _where_flying(field, time_to_go(distance, closing, body.max_force))


def minded(cost: jax.Array) -> jax.Array:
    """Which opponent [E, D] each drone minds, by `cost` [E, D, M]: the one that it is assigned, or
    where it is assigned none that flies, the cheapest.
    """
    drones, opponents = cost.shape[1:]
    cheapest = jnp.argmin(cost, axis=2)
    if drones <= opponents:
        given = jax.vmap(assign)(cost)
    else:
        taken = jax.vmap(assign)(jnp.swapaxes(cost, 1, 2))  # [E, M], each opponent's drone
        mine = taken[:, None] == jnp.arange(drones)[:, None]  # [E, D, M]
        given = jnp.where(jnp.any(mine, axis=2), jnp.argmax(mine, axis=2), cheapest)
    its = jnp.take_along_axis(cost, given[..., None], axis=2)[..., 0]
    return jnp.where(its < OUT, given, cheapest)


def assign(cost: jax.Array) -> jax.Array:
    """The column of each row [R] of `cost` [R, C], R <= C <= 8, all different, with the least sum.

    Exact, by dynamic programming over sets of columns (Bellman, 1962; Held and Karp, 1962): the best
    of the first i rows in the set s is the least over its columns j of cost[i, j] and the best of the
    rows before in s without j. What the Hungarian method finds, without its branches.
    """
    rows, columns = cost.shape
    sets, bits = np.arange(2**columns), 1 << np.arange(columns)
    inside = (sets[:, None] & bits) > 0  # [2^C, C]
    without = sets[:, None] & ~bits
    best = jnp.where(sets == 0, 0.0, jnp.inf)
    chosen = []
    for row in range(rows):
        options = jnp.where(inside, best[without] + cost[row], jnp.inf)
        chosen.append(jnp.argmin(options, axis=1))
        best = jnp.min(options, axis=1)
    used, found = jnp.argmin(best), []
    for last in reversed(chosen):
        column = last[used]
        found.append(column)
        used = used & ~jnp.asarray(bits)[column]
    return jnp.stack(found[::-1])


def situation(field: Field, number: int, other: jax.Array) -> Situation:
    """What one drone sees when it minds the opponent `other` [E]."""
    fights = jnp.arange(other.shape[0])
    own = Drones(*(leaf[:, number] for leaf in field.own))
    its = Drones(*(leaf[fights, other] for leaf in field.others))
    return situation_of(own, its, field.target, field.time)


def _where_flying(field: Field, values: jax.Array) -> jax.Array:
    """`values` [E, D, M] of pairs that fly, OUT for the others."""
    flying = field.own_fly[:, :, None] & field.others_fly[:, None]
    return jnp.where(flying, values, jnp.full_like(values, OUT))


def _ways(own: Drones, others: Drones) -> jax.Array:
    """From each drone to each opponent, [E, D, M, 3] m."""
    return others.position[:, None] - own.position[:, :, None]
