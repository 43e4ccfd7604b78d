"""The observation `engagement`: `ego`, and what guidance steers by: line of sight and closest approach
of the other drones and of the target. And `tracks`, the same without how the others are turned.
Plain arrays of one fight.

What does not live here: the other observations (`observe`, `team_views`, `sight`).
"""

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.combat.sight import Fields, others_of
from dronecombat_jax.combat.team_views import observe_team_ego
from dronecombat_jax.config.sides import Sides
from dronecombat_jax.sim.rotation import rotate_inverse
from dronecombat_jax.types import Drones

NEAR = 0.5  # m, within which a line of sight is not said to turn ever faster
SLOW = 1.0  # m/s, below which nothing is said to come near soon
AHEAD = 1.0  # s, how far the closest approach is looked for
# Of one thing: r range, c closing speed, l rate of the line of sight, n time until it is nearest,
# m where it is then (the miss), u unit direction.
APPROACH_FIELDS: Fields = (("r", 1), ("c", 1), ("l", 3), ("n", 1), ("m", 3), ("u", 3))
TURNED = ("q", "w", "g")  # attitude, rate, gravity in the own frame: how a drone is turned


def engagement_fields(ego: Fields) -> Fields:
    """The parts of `observe_engagement`: those of `ego`, `APPROACH_FIELDS` of each other drone and of
    the target, and how far each other drone is from the target (e_).
    """
    others = [name.partition("_")[2] for name, _ in ego if name.startswith("g_")][1:]
    approaches = [(f"{part}_{who}", n) for who in (*others, "t") for part, n in APPROACH_FIELDS]
    return (*ego, *approaches, *((f"e_{who}", 1) for who in others))


def track_fields(engagement: Fields) -> tuple[Fields, NDArray[np.int32]]:
    """The parts of `tracks`, and their columns among those of `observe_engagement`: all but how
    the others are turned.
    """
    names = np.repeat([name for name, _ in engagement], [length for _, length in engagement])
    kept = lambda name: name.endswith("_self") or name.partition("_")[0] not in TURNED
    columns = np.flatnonzero([kept(name) for name in names]).astype(np.int32)
    return tuple(field for field in engagement if kept(field[0])), columns


def observe_engagement(sides: Sides, drones: Drones, target: jax.Array) -> jax.Array:
    """Observation [A, 29 A + 2], each row in the observing drone's own body frame: `ego`, then
    `approach` of each other drone, team mates first, and of the target, then each other drone's
    distance from the target (m).
    """
    whom, count = others_of(sides), len(sides)
    way = drones.position[whom] - drones.position[:, None]
    goal = target - drones.position
    things = jnp.concatenate([way, goal[:, None]], axis=1)
    velocity = jnp.concatenate([drones.velocity[whom], jnp.zeros((count, 1, 3))], axis=1)
    approached = approach(drones.quaternion, things, velocity - drones.velocity[:, None])
    to_target = jnp.linalg.norm(goal, axis=-1)
    ego = observe_team_ego(sides, drones, target)
    return jnp.concatenate([ego, approached.reshape(count, -1), to_target[whom]], axis=-1)


def approach(quaternion: jax.Array, way: jax.Array, velocity: jax.Array) -> jax.Array:
    """What an observer needs to meet, or to miss, B things at `way` [A, B, 3] m that move at
    `velocity` [A, B, 3] m/s relative to it: [A, B, 12], vectors in its body frame (`quaternion` [A, 4]).

    With r the way and v the velocity: the range |r| (m), the closing speed -r.v / |r| (m/s), the rate
    of the line of sight r x v / (r.r + NEAR^2) (rad/s), the time to the closest approach
    -r.v / max(v.v, SLOW^2) within 0 and AHEAD (s), the way then, r + v t (m, the zero-effort miss), and
    r / |r|. Equations: Zarchan, Tactical and Strategic Missile Guidance, chapter 2; the limits are
    ours, so that no number grows without bound where two drones meet.
    """
    into = lambda vector: rotate_inverse(quaternion[:, None], vector)
    dot = lambda a, b: jnp.sum(a * b, axis=-1, keepdims=True)
    distance = jnp.linalg.norm(way, axis=-1, keepdims=True)
    direction = way / jnp.maximum(distance, 1e-6)
    closing = -dot(direction, velocity)
    turning = jnp.cross(way, velocity) / (distance**2 + NEAR**2)
    time = jnp.clip(closing * distance / jnp.maximum(dot(velocity, velocity), SLOW**2), 0.0, AHEAD)
    miss = way + velocity * time
    parts = (distance, closing, into(turning), time, into(miss), into(direction))
    return jnp.concatenate(parts, axis=-1)
