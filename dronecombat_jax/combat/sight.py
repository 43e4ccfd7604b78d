"""Observations in which others may be hidden, and that say so. Plain arrays of one fight, for any
number of drones.

What does not live here: the table of observations (`observe`), who sees whom (`sensors`).
"""

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.sim.rotation import body_z, rotate_inverse
from dronecombat_jax.types import Drones

Fields = tuple[tuple[str, int], ...]

OWN_FIELDS: Fields = (
    ("p_self", 3), ("q_self", 4), ("p_t", 3), ("v_self", 3), ("w_self", 3), ("g_self", 3),
)  # fmt: skip
OWN_SIZE = sum(length for _, length in OWN_FIELDS)
GROUPS = ("mate", "opponent")  # whom the slots of `observe_nearest` are of
SLOT_FIELDS: Fields = (("p", 3), ("v", 3), ("z", 3), ("seen", 1))  # of one slot
SLOT_SIZE = sum(length for _, length in SLOT_FIELDS)
DOWN = (0.0, 0.0, -1.0)


def own_state(drones: Drones, target: jax.Array) -> jax.Array:
    """What each drone knows of itself and the target, [A, 19], as `OWN_FIELDS` names it.

    Position (m) and quaternion in the world frame; the way to the target (m), velocity (m/s), rate
    (rad/s) and unit gravity in the own body frame.
    """
    into = lambda vector: rotate_inverse(drones.quaternion, vector)
    gravity = jnp.broadcast_to(jnp.asarray(DOWN), drones.position.shape)
    parts = (into(target - drones.position), into(drones.velocity), drones.rate, into(gravity))
    return jnp.concatenate([drones.position, drones.quaternion, *parts], axis=-1)


def bearing_fields(sides: tuple[int, ...]) -> Fields:
    """The parts of `observe_bearing`; with one other drone it is called `other`."""
    names = _names(sides)
    return (
        *OWN_FIELDS,
        *(part for name in names for part in ((f"d_{name}", 3), (f"seen_{name}", 1))),
    )


def observe_bearing(
    sides: tuple[int, ...], drones: Drones, target: jax.Array, seen: jax.Array | None = None
) -> jax.Array:
    """What a camera gives, [A, 19 + 4 (A - 1)]: `own_state`; then of each other drone, team mates
    first, the unit direction to it in the own body frame and 1. Neither distance nor velocity.

    `sides` [A]: the side of each drone. `seen` [A, A] bool: who sees whom; None: everybody. For one
    that is not seen stand four zeros.
    """
    whom = others_of(sides)
    way = drones.position[whom] - drones.position[:, None]
    unit = way / jnp.maximum(jnp.linalg.norm(way, axis=-1, keepdims=True), 1e-6)
    into = rotate_inverse(drones.quaternion[:, None], unit)
    parts = jnp.concatenate([into, jnp.ones_like(into[..., :1])], axis=-1)
    if seen is not None:
        parts = jnp.where(
            jnp.take_along_axis(seen, jnp.asarray(whom), axis=1)[..., None], parts, 0.0
        )
    return jnp.concatenate([own_state(drones, target), parts.reshape(len(sides), -1)], axis=-1)


def nearest_fields(k: int) -> Fields:
    """The parts of `observe_nearest`: `OWN_FIELDS`, k slots of team mates, k of opponents."""
    slots = [f"{group}{slot}" for group in GROUPS for slot in range(1, k + 1)]
    parts = ((f"{name}_{slot}", length) for slot in slots for name, length in SLOT_FIELDS)
    return (*OWN_FIELDS, *parts)


def observe_nearest(
    sides: tuple[int, ...],
    k: int,
    drones: Drones,
    target: jax.Array,
    seen: jax.Array | None = None,
) -> jax.Array:
    """`own_state` and the nearest others, [A, 19 + 2 k 10]: k slots of team mates, then k of
    opponents, each group by distance.

    A slot holds, in the own body frame, the way to the other (m), its velocity (m/s) and its thrust
    axis (body z), then 1. A slot of nobody, because fewer are seen or there, holds ten zeros. The
    length is the same for every size of team. `sides` [A]; `seen` [A, A] bool: who sees whom; None:
    everybody.
    """
    count = len(sides)
    into = lambda vectors: rotate_inverse(drones.quaternion[:, None], vectors)
    way = drones.position[None] - drones.position[:, None]
    velocity, up = (
        jnp.broadcast_to(vector, way.shape)
        for vector in (drones.velocity, body_z(drones.quaternion))
    )
    described = jnp.concatenate(
        [into(way), into(velocity), into(up), jnp.ones((count, count, 1))], axis=-1
    )
    distance = jnp.linalg.norm(way, axis=-1)
    allied = np.equal.outer(sides, sides)
    groups = []
    for group in (allied & ~np.eye(count, dtype=bool), ~allied):
        shown = jnp.asarray(group) if seen is None else group & seen
        known = jnp.where(jnp.asarray(shown), distance, jnp.inf)
        nearest = jnp.argsort(jnp.asarray(known), axis=-1)[:, :k, None]
        slots = jnp.take_along_axis(jnp.where(shown[..., None], described, 0.0), nearest, axis=1)
        groups.append(jnp.pad(slots, ((0, 0), (0, max(k - count, 0)), (0, 0))).reshape(count, -1))
    return jnp.concatenate([own_state(drones, target), *groups], axis=-1)


def others_of(sides: tuple[int, ...]) -> NDArray[np.int32]:
    """Indices [A, A - 1] of the other drones for each: team mates first, then opponents."""
    ranked = [
        sorted((j for j in range(len(sides)) if j != i), key=lambda j: (sides[j] != side, j))
        for i, side in enumerate(sides)
    ]
    return np.asarray(ranked, np.int32).reshape(len(sides), len(sides) - 1)


def _names(sides: tuple[int, ...]) -> list[str]:
    return ["other"] if len(sides) == 2 else [f"other{i}" for i in range(1, len(sides))]
