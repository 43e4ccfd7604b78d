"""What each drone sees, as one vector: eq. 5 in two frames, with what guidance steers by, the nearest
others, or as a camera. Plain arrays of one fight.

To add one, write a function here, name it in OBSERVATIONS with its fields, and among the choices of
`config.GameConfig.observation`. What does not live here: errors, delays and who is hidden
(`sensors`).
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.combat.engagement import engagement_fields, observe_engagement, track_fields
from dronecombat_jax.combat.sight import (
    DOWN,
    Fields,
    bearing_fields,
    nearest_fields,
    observe_bearing,
    observe_nearest,
)
from dronecombat_jax.combat.team_views import (
    columns_of,
    ego_fields,
    ego_order,
    observe_team_ego,
    observe_team_world,
    world_fields,
    world_order,
)
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.config.own import chosen
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.sides import DUEL, spelt
from dronecombat_jax.errors import UserError
from dronecombat_jax.sim.rotation import conjugate, multiply, rotate, rotate_inverse
from dronecombat_jax.types import Drones

Observe = Callable[[Drones, jax.Array], jax.Array]  # (drones [A, ...], target [3]) -> [A, size]


class Observation(NamedTuple):
    """What each drone sees."""

    fields: Fields  # name and length of each part, in order
    observe: Observe
    # The same from what is seen alone: a third argument [A, A] bool, who sees whom; everybody sees
    # itself. None: it cannot hide anybody, and is refused with a sensor's range and the like.
    partial: Callable[[Drones, jax.Array, jax.Array], jax.Array] | None = None
    # it says who is seen; a drone that is down or absent then counts as hidden
    flagged: bool = False

    @property
    def size(self) -> int:
        """Length of the vector."""
        return sum(length for _, length in self.fields)


WORLD_FIELDS = (
    ("p_d", 3), ("q_d", 4), ("p_a", 3), ("q_a", 4), ("p_t", 3),
    ("v_d", 3), ("w_d", 3), ("v_a", 3), ("w_a", 3), ("g_d", 3), ("g_a", 3),
)  # fmt: skip


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


def hiding(fields: Fields, observe: Observe, order: NDArray[np.int32]) -> Observation:
    """The observation `observe` in which the numbers of a drone that is not seen are 0.

    A quaternion or a gravity of 0 is no drone's, so that this tells who is hidden. `order` [A, A]:
    the drones that `fields` name, by observer.
    """
    whom = columns_of(fields, order)

    def partial(drones: Drones, target: jax.Array, seen: jax.Array) -> jax.Array:
        known = jnp.take_along_axis(seen, jnp.asarray(whom), axis=1)
        return jnp.where(known, observe(drones, target), 0.0)

    return Observation(fields, observe, partial)


def world(game: GameConfig) -> Observation:
    """Eq. 5, or the same for teams."""
    if game.sides == DUEL:
        return hiding(WORLD_FIELDS, observe_world, world_order(DUEL))
    look = functools.partial(observe_team_world, game.sides)
    return hiding(world_fields(game.sides), look, world_order(game.sides))


def ego(game: GameConfig) -> Observation:
    """The same in the observing drone's own frame."""
    if game.sides == DUEL:
        return hiding(EGO_FIELDS, observe_ego, ego_order(DUEL))
    look = functools.partial(observe_team_ego, game.sides)
    return hiding(ego_fields(game.sides), look, ego_order(game.sides))


def engagement(game: GameConfig) -> Observation:
    """`ego`, and what guidance steers by (`engagement.observe_engagement`)."""
    fields = engagement_fields(ego(game).fields)
    look = functools.partial(observe_engagement, game.sides)
    return hiding(fields, look, ego_order(game.sides))


def tracks(game: GameConfig) -> Observation:
    """`engagement` without attitude and rate of the others, as a tracker knows them: where they are and
    how they move. What is not seen cannot be used to mislead.
    """
    fields, columns = track_fields(engagement_fields(ego(game).fields))
    look = lambda drones, target: observe_engagement(game.sides, drones, target)[:, columns]
    return hiding(fields, look, ego_order(game.sides))


def bearing(game: GameConfig) -> Observation:
    """The observation of a camera: directions without distances (`sight.observe_bearing`)."""
    look = functools.partial(observe_bearing, game.sides)
    return Observation(bearing_fields(game.sides), look, look, flagged=True)


def nearest(game: GameConfig) -> Observation:
    """The `game.nearest_k` nearest team mates and opponents (`sight.observe_nearest`)."""
    look = functools.partial(observe_nearest, game.sides, game.nearest_k)
    return Observation(nearest_fields(game.nearest_k), look, look, flagged=True)


# An observation, or a function that makes one for the rules of a game.
OBSERVATIONS: dict[str, Observation | Callable[[GameConfig], Observation]] = {
    "world": world,
    "ego": ego,
    "engagement": engagement,
    "tracks": tracks,
    "bearing": bearing,
    "nearest": nearest,
}


def observation_of(config: Config) -> Observation:
    """The observation that `game.observation` names."""
    return layout_of(config.game.observation, config.game)


def layout_of(name: str, game: GameConfig) -> Observation:
    """The observation `name` in a game: of OBSERVATIONS, or MODULE:NAME of one's own."""
    entry = chosen(OBSERVATIONS, name)
    return entry if isinstance(entry, Observation) else entry(game)


def refuse_unfit(config: Config, observation: Observation) -> None:
    """Raise UserError where an observation of one's own does not fit a game of teams."""
    name, sides = config.game.observation, config.game.sides
    if sides == DUEL or name in OBSERVATIONS:
        return
    drones = Drones(*(jnp.zeros((len(sides), width)) for width in (3, 4, 3, 3)))
    given = jax.eval_shape(observation.observe, drones, jnp.zeros(3)).shape
    if given != (wanted := (len(sides), observation.size)):
        raise UserError(
            f"game.observation = {one_line(name)} gives {list(given)} numbers for {spelt(sides)} "
            f"drones, not {list(wanted)}: a function of the game's settings can make one that fits"
        )


def whole_of(config: Config) -> Observation:
    """What a central critic sees: `world`, whatever the policies observe, and who is observing.

    The identity is 1 at the observing drone's own number and 0 at the others'.
    """
    world = layout_of("world", config.game)

    def observe(drones: Drones, target: jax.Array) -> jax.Array:
        seen = world.observe(drones, target)
        return jnp.concatenate([seen, jnp.eye(seen.shape[0])], axis=-1)

    count = len(config.game.sides)
    fields = (("poses", 7 * count), ("p_t", 3), ("twists", 6 * count), ("gravities", 3 * count))
    return Observation((*fields, ("identity", count)), observe)
