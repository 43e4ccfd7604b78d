"""The observation vector of eq. 5, in two frames. Plain arrays of one fight.

To add one, write a function here, name it in OBSERVATIONS with its fields, and among the choices of
`config.GameConfig.observation`.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp

from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.own import chosen
from dronecombat_jax.sim.rotation import conjugate, multiply, rotate, rotate_inverse
from dronecombat_jax.types import Drones

Fields = tuple[tuple[str, int], ...]


class Observation(NamedTuple):
    """What each drone sees."""

    fields: Fields  # name and length of each part, in order
    observe: Callable[[Drones, jax.Array], jax.Array]  # (drones [A, ...], target [3]) -> [A, size]

    @property
    def size(self) -> int:
        """Length of the vector."""
        return sum(length for _, length in self.fields)


WORLD_FIELDS = (
    ("p_d", 3), ("q_d", 4), ("p_a", 3), ("q_a", 4), ("p_t", 3),
    ("v_d", 3), ("w_d", 3), ("v_a", 3), ("w_a", 3), ("g_d", 3), ("g_a", 3),
)  # fmt: skip

DOWN = (0.0, 0.0, -1.0)


def observe_world(drones: Drones, target: jax.Array) -> jax.Array:
    """Observation [A, 35], the same row for both agents (eq. 5).

    Positions and quaternions in the world frame; velocities, rates and unit gravity in each
    drone's body frame. `drones` fields are [A, ...], `target` is [3] m.
    """
    velocity = rotate_inverse(drones.quaternion, drones.velocity)
    gravity = rotate_inverse(
        drones.quaternion, jnp.broadcast_to(jnp.asarray(DOWN), drones.position.shape)
    )
    pose = jnp.concatenate([drones.position, drones.quaternion], axis=-1).reshape(-1)
    twist = jnp.concatenate([velocity, drones.rate], axis=-1).reshape(-1)
    row = jnp.concatenate([pose, target, twist, gravity.reshape(-1)])
    return jnp.broadcast_to(row, (len(drones.position), row.shape[0]))


def observe_ego(drones: Drones, target: jax.Array) -> jax.Array:
    """Observation [A, 35], each row in the observing drone's own body frame: self first, then the
    other.

    Own position and quaternion stay in the world frame (altitude and attitude are absolute); the
    other's position and the target are relative and rotated into the own frame, as are the
    other's attitude (own^-1 * other), velocity and rate; each gravity is in its drone's own frame.
    """
    other = Drones(*(jnp.flip(field, axis=0) for field in drones))
    own = drones.quaternion
    into = lambda vector: rotate_inverse(own, vector)
    gravity = rotate_inverse(own, jnp.broadcast_to(jnp.asarray(DOWN), drones.position.shape))
    return jnp.concatenate(
        [
            drones.position,
            own,
            into(other.position - drones.position),
            multiply(conjugate(own), other.quaternion),
            into(target - drones.position),
            into(drones.velocity),
            drones.rate,
            into(other.velocity),
            into(rotate(other.quaternion, other.rate)),
            gravity,
            jnp.flip(gravity, axis=0),
        ],
        axis=-1,
    )


EGO_FIELDS = tuple(
    (name.replace("_d", "_self").replace("_a", "_other"), length) for name, length in WORLD_FIELDS
)
OBSERVATIONS: dict[str, Observation] = {
    "world": Observation(WORLD_FIELDS, observe_world),
    "ego": Observation(EGO_FIELDS, observe_ego),
}


def observation_of(config: Config) -> Observation:
    """The observation that `game.observation` names."""
    return chosen(OBSERVATIONS, config.game.observation)


def whole_of(config: Config) -> Observation:
    """What a central critic sees: `world`, whatever the policies observe, and who is observing.

    The identity is 1 at the observing drone's own number and 0 at the others'.
    """
    world = observation_of(replace(config, game=replace(config.game, observation="world")))

    def observe(drones: Drones, target: jax.Array) -> jax.Array:
        seen = world.observe(drones, target)
        return jnp.concatenate([seen, jnp.eye(seen.shape[0])], axis=-1)

    return Observation((*world.fields, ("identity", len(config.game.sides))), observe)
