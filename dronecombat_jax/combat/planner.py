"""Pilots that look ahead: each tries its choices against what the other side may do, in a model of
the flight, and flies the choice that ends best.

Rollouts of base policies (Bertsekas, Dynamic Programming and Optimal Control, volume 1, 2005, chapter
6) against several models of the other side, weighted by how well each explains its present thrust
axis. Anew at every control step: nothing is remembered, nothing is random. What does not live here:
the laws and what is tried (`choices`), the controller (`autopilot`).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.autopilot import Airframe, attainable
from dronecombat_jax.combat.choices import OTHER, OWN, Choices
from dronecombat_jax.combat.guidance import Guidance, Situation, dot, time_to_go, unit
from dronecombat_jax.combat.rules import closest_approach
from dronecombat_jax.config.fields import GameConfig
from dronecombat_jax.types import ATTACKER, DEFENDER

AHEAD = 40  # steps of the model
STEP = 0.04  # s, of the model
TURNED = 0.6  # share of the way that the thrust axis turns in a model step
MARGIN = 0.03  # m, a pass is not planned closer than this to a strike
FLOOR = 0.15  # m above the altitude of a crash, under which no choice may go
# how sharply a model is told by the cosine between the thrust that it wants and the real one
LIKENESS = 8.0
PUSH = 15.0  # m/s^2, of a drone on its way to the target
DECIDED = 10.0  # what a decided fight is worth; undecided ones are worth a few tenths


class Body(NamedTuple):
    """One drone in the model: a point with a thrust axis. World frame, m and m/s, [..., 3]."""

    position: jax.Array
    velocity: jax.Array
    up: jax.Array  # body z


class Ends(NamedTuple):
    """How rollouts ended, each [I, J, E]: by own choice and by model of the other side."""

    won: jax.Array  # bool
    lost: jax.Array  # bool
    when: jax.Array  # model steps until it was decided
    gap: jax.Array  # m, the least distance between the drones
    near: jax.Array  # m, the least distance of the attacker from the target
    lead: jax.Array  # s, by which the attacker would be at the target before the defender


def build_plan(role: int, game: GameConfig, mine: Airframe, its: Airframe) -> Guidance:
    """The guidance of `role` that looks ahead, for the rules of `game`, its own airframe and the
    other side's.
    """
    own, other, bodies = OWN[role], OTHER[role], (mine, its)

    def plan(body: Airframe, now: Situation) -> jax.Array:
        ends = imagine(role, game, bodies, own, other, now)
        value = jnp.sum(_worth(role, ends) * _likeness(its, other, now), axis=1)
        best = jnp.argmax(value, axis=0)
        wanted = _wanted(body, own, now, jnp.zeros(()))
        return jnp.take_along_axis(wanted, best[None, :, None], axis=0)[0]

    return plan


def imagine(
    role: int,
    game: GameConfig,
    bodies: tuple[Airframe, Airframe],
    own: tuple[Choices, ...],
    other: tuple[Choices, ...],
    now: Situation,
) -> Ends:
    """Fly every own choice [I] against every model [J] of the other side, AHEAD steps."""
    count = (sum(len(c.parameters) for c in own), sum(len(c.parameters) for c in other))
    wide = lambda x: jnp.broadcast_to(x, (*count, *x.shape))
    mine = Body(*map(wide, (now.position, now.velocity, now.up)))
    theirs = Body(*map(wide, (now.other_position, now.other_velocity, now.other_up)))
    shape = (*count, len(now.time))
    far = jnp.full(shape, 1e3)
    no = jnp.zeros(shape, bool)

    def tick(
        carry: tuple[Body, Body, Ends], step: jax.Array
    ) -> tuple[tuple[Body, Body, Ends], None]:
        mine, theirs, ends = carry
        elapsed = step * STEP
        seen = lambda me, it: _seen(me, it, now.target, now.time + elapsed)
        by_model = jax.vmap(
            lambda me, it: _by_choice(bodies[0], own, seen(me, it), elapsed),
            in_axes=1,
            out_axes=1,
        )
        by_own = jax.vmap(lambda me, it: _by_choice(bodies[1], other, seen(me, it), elapsed))
        moved = _moved(bodies[0], mine, by_model(mine, theirs))
        it_moved = _moved(bodies[1], theirs, by_own(theirs, mine))
        ends = _judge(role, game, now.target, (mine, theirs), (moved, it_moved), ends)
        return (moved, it_moved, ends), None

    start = Ends(no, no, jnp.zeros(shape), far, far, jnp.zeros(shape))
    (_, _, ends), _ = jax.lax.scan(tick, (mine, theirs, start), jnp.arange(AHEAD))
    return ends


def _by_choice(
    body: Airframe, choices: tuple[Choices, ...], now: Situation, elapsed: jax.Array
) -> jax.Array:
    """Thrust over mass [I, E, 3] that each choice asks for in its own situation [I, E, ...]."""
    forces, first = [], 0
    for law, parameters in choices:
        last = first + len(parameters)
        mine = Situation(*(field[first:last] for field in now))
        ask = lambda numbers, now, law=law: _force(body, now, law(body, now, numbers, elapsed))
        forces.append(jax.vmap(ask)(jnp.asarray(parameters), mine))
        first = last
    return jnp.concatenate(forces)


def _seen(me: Body, it: Body, target: jax.Array, time: jax.Array) -> Situation:
    """The situations [I, E, ...] of one side; target and time are the same for all I."""
    shape = me.position.shape
    same = jnp.broadcast_to(target, shape), jnp.broadcast_to(time, shape[:-1])
    return Situation(*me, *it, *same)


def _wanted(
    body: Airframe, choices: tuple[Choices, ...], now: Situation, elapsed: jax.Array
) -> jax.Array:
    """Acceleration [I, E, 3] that each choice asks for in one situation [E, ...]."""
    asked = [
        jax.vmap(lambda numbers, law=law: law(body, now, numbers, elapsed))(jnp.asarray(parameters))
        for law, parameters in choices
    ]
    return jnp.concatenate(asked)


def _force(body: Airframe, now: Situation, wanted: jax.Array) -> jax.Array:
    return attainable(body, now.position[:, 2], now.velocity[:, 2], wanted)


def _moved(body: Airframe, drone: Body, force: jax.Array) -> Body:
    """One model step: the thrust axis turns a share of the way to `force`, thrust is what of it lies
    along the axis.
    """
    up = unit(drone.up + TURNED * (unit(force) - drone.up))
    mean = unit(drone.up + up)
    thrust = jnp.clip(dot(force, mean), 0.0, body.max_force)
    velocity = drone.velocity + STEP * (thrust * mean).at[..., 2].add(-body.gravity)
    return Body(drone.position + 0.5 * STEP * (drone.velocity + velocity), velocity, up)


def _judge(
    role: int,
    game: GameConfig,
    target: jax.Array,
    before: tuple[Body, Body],
    after: tuple[Body, Body],
    ends: Ends,
) -> Ends:
    """What a model step decided, of the fights that were not yet decided."""
    mine, theirs = (x.position for x in before)
    moved, it_moved = (x.position for x in after)
    attacker, attacked = (mine, moved) if role == ATTACKER else (theirs, it_moved)
    gap = closest_approach(mine - theirs, moved - it_moved)
    near = closest_approach(attacker - target, attacked - target)
    sign = 1.0 if role == ATTACKER else -1.0
    struck = gap < game.intercept_radius + sign * MARGIN
    reached = (near < game.reach_radius - sign * MARGIN) & ~struck
    down = moved[..., 2] < game.crash_altitude + FLOOR
    won, lost = (reached, struck) if role == ATTACKER else (struck, reached)
    live = ~(ends.won | ends.lost)
    keep = lambda new, old: jnp.where(live, new, old)
    attacking = after if role == DEFENDER else after[::-1]
    arrival = lambda drone: _arrival(drone, target, game.reach_radius)
    return Ends(
        ends.won | (live & won & ~down),
        ends.lost | (live & (lost | down)),
        ends.when + live,
        keep(jnp.minimum(ends.gap, gap), ends.gap),
        keep(jnp.minimum(ends.near, near), ends.near),
        keep(arrival(attacking[0]) - arrival(attacking[1]), ends.lead),
    )


def _arrival(drone: Body, target: jax.Array, radius: float) -> jax.Array:
    """Seconds to `radius` m from the target with a steady push towards it."""
    way = target - drone.position
    distance = jnp.linalg.norm(way, axis=-1)
    closing = dot(drone.velocity, unit(way))[..., 0]
    return time_to_go(jnp.maximum(distance - radius, 0.0), closing, PUSH)


def _worth(role: int, ends: Ends) -> jax.Array:
    """What each rollout is worth to `role`, [I, J, E]: won soon, lost late, or the better placed."""
    attacks = role == ATTACKER
    spare, miss = (ends.gap, ends.near) if attacks else (ends.near, ends.gap)
    won = DECIDED - 0.04 * ends.when + jnp.minimum(spare, 2.0)
    lost = -DECIDED + 0.1 * ends.when - miss
    lead = ends.lead if attacks else -ends.lead
    open_ = 2.0 * lead - (0.1 * ends.near if attacks else 0.2 * ends.gap)
    return jnp.where(ends.won, won, jnp.where(ends.lost, lost, open_))


def _likeness(body: Airframe, models: tuple[Choices, ...], now: Situation) -> jax.Array:
    """Weights [J, E] of the models of the other side, sum 1: the nearer the thrust that a model asks
    for is to the other drone's thrust axis, the larger.
    """
    its = Situation(
        now.other_position, now.other_velocity, now.other_up, now.position, now.velocity, now.up,
        now.target, now.time,
    )  # fmt: skip
    asked = jax.vmap(lambda wanted: _force(body, its, wanted))(
        _wanted(body, models, its, jnp.zeros(()))
    )
    return jax.nn.softmax(LIKENESS * dot(unit(asked), now.other_up)[..., 0], axis=0)
