"""Scripted pilots: plain opponents that fly the game's own wrench, to measure learnt policies
against.

A pilot is a pure function `(state [E, ...], observation [E, A, 35], key) -> action [E, 4]`, as
everywhere in a match; these read the state alone, draw nothing and remember nothing. In here: each
one's guidance, which answers with a wanted acceleration. Not in here: the controller that flies it
(`autopilot`) and the fights (`arena`).
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.autopilot import (
    MIN_LIFT,
    VELOCITY_GAIN,
    Airframe,
    airframe,
    attainable,
    steer,
)
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.sides import Sides, team
from dronecombat_jax.errors import UserError
from dronecombat_jax.sim.flight import split
from dronecombat_jax.sim.rotation import body_z
from dronecombat_jax.sim.scene import Scene
from dronecombat_jax.types import ATTACKER, DEFENDER, SIDES, Drones, EnvState

Pilot = Callable[[EnvState, jax.Array, jax.Array], jax.Array]

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
GUARD_BRAKING = 12.0  # m/s^2
GUARD_GAIN = 3.0  # 1/s
GUARD_HURRY = 1.5  # its speed over the one that gets it there with the attacker
NAVIGATION_CONSTANT = 3.0


class Situation(NamedTuple):
    """One role's view of E fights: world frame, m and m/s."""

    position: jax.Array  # [E, 3]
    velocity: jax.Array  # [E, 3]
    other_position: jax.Array  # [E, 3]
    other_velocity: jax.Array  # [E, 3]
    other_up: jax.Array  # [E, 3] its body z axis
    target: jax.Array  # [E, 3]
    time: jax.Array  # [E] s since the start


# -> wanted acceleration [E, 3] m/s^2, world frame
Guidance = Callable[[Airframe, Situation], jax.Array]


def build_pilot(
    name: str, config: Config, scene: Scene, role: int | None = None, drone: int | None = None
) -> Pilot:
    """The scripted pilot `name` of `PILOTS`, for this body and clock, at the controls of `drone`
    (None: the first of its side).

    In a team each drone flies on its own, against the nearest opponent that flies. Raises UserError for an unknown name, or one that flies the other `role`.
    """
    for its_role, guidances in PILOTS.items():
        if name in guidances and role in (None, its_role):
            sides = config.game.sides
            drone = sides.index(its_role) if drone is None else drone
            body = airframe(config, scene, drone)
            return _pilot(sides, drone, guidances[name], body, config.control_dt)
    roles = PILOTS if role is None else (role,)
    names = "; ".join(f"{SIDES[side]}s: {', '.join(PILOTS[side])}" for side in roles)
    raise UserError(f"{one_line(name)}: no scripted pilot has this name ({names})")


def one_per_fight(pilots: Sequence[Pilot], which: jax.Array) -> Pilot:
    """Fight e is flown by `pilots[which[e]]`, `which` [E] int: many pairs in one program. All get
    the same key.
    """

    def act(state: EnvState, observation: jax.Array, key: jax.Array) -> jax.Array:
        actions = jnp.stack([pilot(state, observation, key) for pilot in pilots])
        return actions[which, jnp.arange(which.shape[0])]

    return act


def _pilot(sides: Sides, drone: int, guidance: Guidance, body: Airframe, step: float) -> Pilot:
    def act(state: EnvState, observation: jax.Array, key: jax.Array) -> jax.Array:
        drones = split(state.qpos, state.qvel)
        other = _opponent(sides, drone, drones, state.down)
        situation = _situation(drones, drone, other, state.target, state.clock * step)
        wanted = guidance(body, situation)
        force = attainable(body, situation.position[:, 2], situation.velocity[:, 2], wanted)
        speeds = None if state.craft is None else state.craft.speeds
        mine = None if speeds is None else speeds[:, drone]
        return steer(body, drones.quaternion[:, drone], drones.rate[:, drone], force, mine)

    return act


def _opponent(sides: Sides, drone: int, drones: Drones, down: jax.Array) -> Drones:
    """The opponent that the pilot of `drone` minds, fields [E, ...]: the only one, or the nearest
    that flies, or the nearest of all where none does.
    """
    others = team(sides, 1 - sides[drone])
    if others.stop - others.start == 1:
        return Drones(*(field[:, others.start] for field in drones))
    way = drones.position[:, others] - drones.position[:, drone, None]
    flies = ~down[:, others]
    minded = flies | ~jnp.any(flies, axis=1, keepdims=True)
    nearest = jnp.argmin(jnp.where(minded, jnp.sum(way**2, axis=-1), jnp.inf), axis=1)
    fights = jnp.arange(nearest.shape[0])
    return Drones(*(field[fights, others.start + nearest] for field in drones))


def _situation(
    drones: Drones, drone: int, other: Drones, target: jax.Array, time: jax.Array
) -> Situation:
    return Situation(
        drones.position[:, drone],
        drones.velocity[:, drone],
        other.position,
        other.velocity,
        body_z(other.quaternion),
        target,
        time,
    )


# Attackers


def _dash(body: Airframe, now: Situation) -> jax.Array:
    """Straight at the target under full thrust; no braking."""
    return _rush(body, now.velocity, now.target - now.position)


def _weave(body: Airframe, now: Situation) -> jax.Array:
    """Like dash, swinging from side to side until it is near; the phase comes from the target's
    altitude.
    """
    way = now.target - now.position
    side = _unit(jnp.stack([-way[:, 1], way[:, 0], jnp.zeros_like(way[:, 0])], axis=-1))
    phase = WEAVE_RATE * now.time + WEAVE_PHASE * now.target[:, 2]
    near = jnp.clip((jnp.linalg.norm(way, axis=-1) - WEAVE_END) / WEAVE_END, 0.0, 1.0)
    swing = near * WEAVE_SPEED * jnp.cos(phase)
    return _rush(body, now.velocity - swing[:, None] * side, way)


def _high_dive(body: Airframe, now: Situation) -> jax.Array:
    """Climb on the way in, then fall on the target from above.

    It dives once the fall to the target takes as long as the way over ground, a little faster over
    ground than that so that the choice stands; later its descent tells that it is diving: no memory
    is needed.
    """
    way = now.target - now.position
    over_ground = way.at[:, 2].set(0.0)
    ahead = _unit(over_ground)
    distance = jnp.linalg.norm(over_ground, axis=-1, keepdims=True)
    climb, above = now.velocity[:, 2:], jnp.maximum(-way[:, 2:], 0.0)
    fall = (climb + jnp.sqrt(climb**2 + 2.0 * DIVE_FALL * above)) / DIVE_FALL
    meeting = distance / jnp.maximum(fall, 0.1)  # the speed over ground that arrives with the fall
    in_time = meeting < _dot(now.velocity, ahead)
    diving = (in_time | (climb < -DIVE_COMMITTED)) & (above > 0.0)

    rise = jnp.clip(2.0 * (DIVE_HEIGHT + way[:, 2:]), 0.0, DIVE_CLIMB)
    speed = jnp.where(diving, jnp.minimum(DIVE_LEAD * meeting, DIVE_SPEED), DIVE_SPEED)
    wanted = VELOCITY_GAIN * (speed * ahead + rise * jnp.asarray([0.0, 0.0, 1.0]) - now.velocity)
    return wanted.at[:, 2].set(jnp.where(diving[:, 0], -DIVE_FALL, wanted[:, 2]))


# Defenders


def _hover(body: Airframe, now: Situation) -> jax.Array:
    """Stay: it starts at rest, so no velocity means no displacement."""
    return -VELOCITY_GAIN * now.velocity


def _hover_guard(body: Airframe, now: Situation) -> jax.Array:
    """Stand on the attacker's way, at the target in the end; hurry there if the attacker comes
    first.
    """
    line = now.other_position - now.target
    length = jnp.linalg.norm(line, axis=-1, keepdims=True)
    post = now.target + jnp.minimum(GUARD_DISTANCE, 0.5 * length) * _unit(line)
    way = post - now.position
    distance = jnp.linalg.norm(way, axis=-1, keepdims=True)
    stopping = jnp.minimum(GUARD_GAIN * distance, jnp.sqrt(2.0 * GUARD_BRAKING * distance))
    incoming = post - now.other_position
    closing = jnp.maximum(_dot(now.other_velocity, _unit(incoming)), 0.0)
    hurried = (
        GUARD_HURRY
        * distance
        * closing
        / jnp.maximum(jnp.linalg.norm(incoming, axis=-1, keepdims=True), 0.3)
    )
    return VELOCITY_GAIN * (jnp.maximum(stopping, hurried) * _unit(way) - now.velocity)


def _pure_pursuit(body: Airframe, now: Situation) -> jax.Array:
    """Always straight at where the attacker is."""
    return _rush(body, now.velocity, now.other_position - now.position)


def _proportional_navigation(body: Airframe, now: Situation) -> jax.Array:
    """Augmented proportional navigation: turn with the line of sight, close under what thrust is
    left.

    Across the line of sight, N (v t + a t^2 / 2) / t^2 for the time to go t (Zarchan, "Tactical and
    Strategic Missile Guidance"). The attacker's acceleration is read off its tilt: g tan(tilt) if
    it holds its altitude.
    """
    sight = now.other_position - now.position
    along = _unit(sight)
    distance = jnp.linalg.norm(sight, axis=-1, keepdims=True)
    relative = now.other_velocity - now.velocity
    closing = -_dot(relative, along)
    time = (jnp.sqrt(closing**2 + 2.0 * body.max_force * distance) - closing) / body.max_force
    lift = jnp.minimum(body.gravity / jnp.maximum(now.other_up[:, 2:], 1e-3), body.max_force)
    turning = (lift * now.other_up).at[:, 2].add(-body.gravity)
    across = lambda vector: vector - _dot(vector, along) * along
    miss = across(relative) / jnp.maximum(time, 0.05) + 0.5 * across(turning)
    return _full_thrust(body, along, NAVIGATION_CONSTANT * miss)


PILOTS: dict[int, dict[str, Guidance]] = {
    DEFENDER: {
        "hover": _hover,
        "hover_guard": _hover_guard,
        "pure_pursuit": _pure_pursuit,
        "proportional_navigation": _proportional_navigation,
    },
    ATTACKER: {"dash": _dash, "weave": _weave, "high_dive": _high_dive},
}


# Guidance they share


def _rush(body: Airframe, velocity: jax.Array, way: jax.Array) -> jax.Array:
    """Full thrust along `way` [E, 3] while the `velocity` across it dies out."""
    along = _unit(way)
    return _full_thrust(body, along, -VELOCITY_GAIN * (velocity - _dot(velocity, along) * along))


def _full_thrust(body: Airframe, along: jax.Array, across: jax.Array) -> jax.Array:
    """Acceleration `across` + s `along` with the largest s that full thrust and the least lift
    allow.
    """
    held = across.at[:, 2].add(body.gravity)  # thrust over mass without the part along
    projection = _dot(held, along)
    room = projection**2 - _dot(held, held) + body.max_force**2
    most = jnp.sqrt(jnp.maximum(room, 0.0)) - projection
    descent = jnp.maximum(-along[:, 2:], 1e-3)
    until_least_lift = jnp.maximum(held[:, 2:] - MIN_LIFT * body.gravity, 0.0) / descent
    return across + jnp.minimum(most, until_least_lift) * along


def _dot(left: jax.Array, right: jax.Array) -> jax.Array:
    return jnp.sum(left * right, axis=-1, keepdims=True)


def _unit(vector: jax.Array) -> jax.Array:
    return vector / jnp.maximum(jnp.linalg.norm(vector, axis=-1, keepdims=True), 1e-6)
