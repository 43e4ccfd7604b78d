"""Guidance of the scripted pilots: from a situation to a wanted acceleration, one function for each law.

They read the state alone, draw nothing and remember nothing. What does not live here: the pilots
and their names (`scripted`), the controller that flies them (`autopilot`).
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.autopilot import MIN_LIFT, VELOCITY_GAIN, Airframe
from dronecombat_jax.sim.rotation import body_z
from dronecombat_jax.types import Drones

WEAVE_SPEED = 3.0  # m/s to either side
WEAVE_RATE = 5.0  # rad/s
WEAVE_PHASE = 1000.0  # rad per m of the target's altitude
WEAVE_END = 2.5  # m before the target it flies straight; from twice that on it swings less
DIVE_HEIGHT = 2.5  # m above the target
DIVE_SPEED = 6.0  # m/s over ground before the dive
DIVE_CLIMB = 4.0  # m/s, the fastest climb
DIVE_FALL = 7.0  # m/s^2, downwards in the dive
DIVE_LEAD = 1.1  # its speed over the one that arrives with the fall
DIVE_COMMITTED = 0.5  # m/s, a descent that fast is the dive
GUARD_DISTANCE = 2.0  # m from the target, towards the attacker
SOONEST = 0.05  # s, an arrival of the attacker that a guard reckons with
NAVIGATION_CONSTANT = 3.0


class Stance(NamedTuple):
    """How one goes to a post and keeps it."""

    gain: float  # 1/s
    braking: float  # m/s^2
    hurry: float  # its speed over the one that gets it there with the attacker
    velocity_gain: float = VELOCITY_GAIN  # 1/s
    along: float | None = None  # its speed around the target over the one that keeps it between
    # the attacker's push over its full thrust, when it reckons when that comes; None: it keeps its speed
    push: float | None = None


class Keeper(NamedTuple):
    """How a goalkeeper stands."""

    stance: Stance
    distance: float  # m from the target, as GUARD_DISTANCE
    look: float  # s, so far ahead it looks for the attacker


GUARD = Stance(gain=3.0, braking=12.0, hurry=1.5)
KEEPER = Keeper(
    Stance(gain=1.9, braking=11.0, hurry=0.85, velocity_gain=9.3, along=1.1, push=0.94),
    distance=0.39,
    look=0.016,
)


class Situation(NamedTuple):
    """One role's view of E fights: world frame, m and m/s."""

    position: jax.Array  # [E, 3]
    velocity: jax.Array  # [E, 3]
    up: jax.Array  # [E, 3] its body z axis
    other_position: jax.Array  # [E, 3]
    other_velocity: jax.Array  # [E, 3]
    other_up: jax.Array  # [E, 3] the other's
    target: jax.Array  # [E, 3]
    time: jax.Array  # [E] s since the start


# -> wanted acceleration [E, 3] m/s^2, world frame
Guidance = Callable[[Airframe, Situation], jax.Array]


# Attackers


def dash(body: Airframe, now: Situation) -> jax.Array:
    """Straight at the target under full thrust; no braking."""
    return rush(body, now.velocity, now.target - now.position)


def weave(body: Airframe, now: Situation) -> jax.Array:
    """Like dash, swinging from side to side until it is near; the phase comes from the target's
    altitude.
    """
    way = now.target - now.position
    side = left_of(way)
    phase = WEAVE_RATE * now.time + WEAVE_PHASE * now.target[:, 2]
    near = jnp.clip((jnp.linalg.norm(way, axis=-1) - WEAVE_END) / WEAVE_END, 0.0, 1.0)
    swing = near * WEAVE_SPEED * jnp.cos(phase)
    return rush(body, now.velocity - swing[:, None] * side, way)


def high_dive(body: Airframe, now: Situation) -> jax.Array:
    """Climb on the way in, then fall on the target from above.

    It dives once the fall to the target takes as long as the way over ground, a little faster over
    ground than that so that the choice stands; later its descent tells that it is diving: no memory
    is needed.
    """
    way = now.target - now.position
    over_ground = way.at[:, 2].set(0.0)
    ahead = unit(over_ground)
    distance = jnp.linalg.norm(over_ground, axis=-1, keepdims=True)
    climb, above = now.velocity[:, 2:], jnp.maximum(-way[:, 2:], 0.0)
    fall = (climb + jnp.sqrt(climb**2 + 2.0 * DIVE_FALL * above)) / DIVE_FALL
    meeting = distance / jnp.maximum(fall, 0.1)  # the speed over ground that arrives with the fall
    in_time = meeting < dot(now.velocity, ahead)
    diving = (in_time | (climb < -DIVE_COMMITTED)) & (above > 0.0)

    rise = jnp.clip(2.0 * (DIVE_HEIGHT + way[:, 2:]), 0.0, DIVE_CLIMB)
    speed = jnp.where(diving, jnp.minimum(DIVE_LEAD * meeting, DIVE_SPEED), DIVE_SPEED)
    wanted = VELOCITY_GAIN * (speed * ahead + rise * jnp.asarray([0.0, 0.0, 1.0]) - now.velocity)
    return wanted.at[:, 2].set(jnp.where(diving[:, 0], -DIVE_FALL, wanted[:, 2]))


# Defenders


def hover(body: Airframe, now: Situation) -> jax.Array:
    """Stay: it starts at rest, so no velocity means no displacement."""
    return -VELOCITY_GAIN * now.velocity


def hover_guard(
    body: Airframe, now: Situation, distance: float | jax.Array = GUARD_DISTANCE
) -> jax.Array:
    """Stand on the attacker's way, `distance` m from the target, at it in the end; hurry there if the
    attacker comes first.
    """
    return _stand(body, now, now.other_position, distance, GUARD)


def goalkeeper(body: Airframe, now: Situation, keeper: Keeper = KEEPER) -> jax.Array:
    """Stand close before the target, on the side of the attacker, and go around the target with it.

    So near, it stops whoever comes in on its side (docs/pilots.md). Its numbers were found by experiment.
    """
    ahead = now.other_position + keeper.look * now.other_velocity
    return _stand(body, now, ahead, keeper.distance, keeper.stance)


def post(attacker: jax.Array, target: jax.Array, distance: float | jax.Array) -> jax.Array:
    """Where a guard stands, [..., 3] m: `distance` m before the target, towards the attacker;
    half-way where that is nearer.
    """
    line = attacker - target
    length = jnp.linalg.norm(line, axis=-1, keepdims=True)
    return target + jnp.minimum(distance, 0.5 * length) * unit(line)


def _stand(
    body: Airframe, now: Situation, other: jax.Array, distance: float | jax.Array, stance: Stance
) -> jax.Array:
    """Go to the post, `distance` m from the target towards `other`, and stay there."""
    goal = post(other, now.target, distance)
    way = goal - now.position
    away = jnp.linalg.norm(way, axis=-1, keepdims=True)
    stopping = jnp.minimum(stance.gain * away, jnp.sqrt(2.0 * stance.braking * away))
    incoming = goal - other
    closing = jnp.maximum(dot(now.other_velocity, unit(incoming)), 0.0)
    left = jnp.linalg.norm(incoming, axis=-1, keepdims=True)
    if stance.push is None:
        hurried = stance.hurry * away * closing / jnp.maximum(left, 0.3)
    else:
        arrival = time_to_go(left, closing, stance.push * body.max_force)
        hurried = stance.hurry * away / jnp.maximum(arrival, SOONEST)
    wanted = jnp.maximum(stopping, hurried) * unit(way)
    if stance.along is not None:
        line = other - now.target
        length = jnp.linalg.norm(line, axis=-1, keepdims=True)
        before = jnp.minimum(distance, 0.5 * length)
        around = now.other_velocity - dot(now.other_velocity, unit(line)) * unit(line)
        wanted = wanted + stance.along * before / jnp.maximum(length, 0.3) * around
    return stance.velocity_gain * (wanted - now.velocity)


def pure_pursuit(body: Airframe, now: Situation) -> jax.Array:
    """Always straight at where the attacker is."""
    return rush(body, now.velocity, now.other_position - now.position)


def proportional_navigation(
    body: Airframe, now: Situation, constant: float | jax.Array = NAVIGATION_CONSTANT
) -> jax.Array:
    """Augmented proportional navigation: turn with the line of sight, close under what thrust is
    left.

    Across the line of sight, N (v t + a t^2 / 2) / t^2 for the time to go t (Zarchan, "Tactical and
    Strategic Missile Guidance"). The attacker's acceleration is read off its tilt: g tan(tilt) if
    it holds its altitude.
    """
    sight = now.other_position - now.position
    along = unit(sight)
    distance = jnp.linalg.norm(sight, axis=-1, keepdims=True)
    relative = now.other_velocity - now.velocity
    time = time_to_go(distance, -dot(relative, along), body.max_force)
    lift = jnp.minimum(body.gravity / jnp.maximum(now.other_up[:, 2:], 1e-3), body.max_force)
    turning = (lift * now.other_up).at[:, 2].add(-body.gravity)
    across = lambda vector: vector - dot(vector, along) * along
    miss = across(relative) / jnp.maximum(time, 0.05) + 0.5 * across(turning)
    return full_thrust(body, along, constant * miss)


# Guidance they share


def rush(body: Airframe, velocity: jax.Array, way: jax.Array) -> jax.Array:
    """Full thrust along `way` [E, 3] while the `velocity` across it dies out."""
    along = unit(way)
    return full_thrust(body, along, -VELOCITY_GAIN * (velocity - dot(velocity, along) * along))


def full_thrust(body: Airframe, along: jax.Array, across: jax.Array) -> jax.Array:
    """Acceleration `across` + s `along` with the largest s that full thrust and the least lift
    allow.
    """
    held = across.at[:, 2].add(body.gravity)  # thrust over mass without the part along
    projection = dot(held, along)
    room = projection**2 - dot(held, held) + body.max_force**2
    most = jnp.sqrt(jnp.maximum(room, 0.0)) - projection
    descent = jnp.maximum(-along[:, 2:], 1e-3)
    until_least_lift = jnp.maximum(held[:, 2:] - MIN_LIFT * body.gravity, 0.0) / descent
    return across + jnp.minimum(most, until_least_lift) * along


def time_to_go(distance: jax.Array, closing: jax.Array, push: float | jax.Array) -> jax.Array:
    """Seconds t until `distance` m are flown, `closing` at m/s now and pushed by `push` m/s^2:
    c t + a t^2 / 2 = d.
    """
    return (jnp.sqrt(closing**2 + 2.0 * push * distance) - closing) / push


def left_of(way: jax.Array) -> jax.Array:
    """The unit vector [E, 3] to the left of `way` [E, 3], level with the ground."""
    return unit(jnp.stack([-way[:, 1], way[:, 0], jnp.zeros_like(way[:, 0])], axis=-1))


def situation_of(own: Drones, other: Drones, target: jax.Array, time: jax.Array) -> Situation:
    """The situations of drones `own` and their opponents `other`, fields [E, ...]."""
    seen = lambda it: (it.position, it.velocity, body_z(it.quaternion))
    return Situation(*seen(own), *seen(other), target, time)


def dot(left: jax.Array, right: jax.Array) -> jax.Array:
    return jnp.sum(left * right, axis=-1, keepdims=True)


def unit(vector: jax.Array) -> jax.Array:
    return vector / jnp.maximum(jnp.linalg.norm(vector, axis=-1, keepdims=True), 1e-6)
