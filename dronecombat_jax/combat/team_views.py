"""The observations `world` and `ego` for teams: every drone of the fight, in one vector each.

What does not live here: the same for one drone a side, which is eq. 5 (`observe`), and observations
in which some are hidden (`sight`). Plain arrays of one fight.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.combat.sight import DOWN, Fields, others_of
from dronecombat_jax.config.sides import Sides, drone_names, mates
from dronecombat_jax.sim.rotation import conjugate, multiply, rotate, rotate_inverse
from dronecombat_jax.types import Drones

_LETTERS = "da"  # of the sides, as in eq. 5


def world_order(sides: Sides) -> NDArray[np.int32]:
    """[A, A]: which drone stands in each place of `world`, by observer: defenders, then attackers,
    but in its own team the observer comes first.

    Team mates share a policy: without this each would see the same and do the same.
    """
    rows = []
    for drone, side in enumerate(sides):
        members = mates(sides, side)
        own = [drone, *(mate for mate in members if mate != drone)]
        rows.append([*range(members.start), *own, *range(members.stop, len(sides))])
    return np.asarray(rows, np.int32)


def ego_order(sides: Sides) -> NDArray[np.int32]:
    """[A, A]: the same for `ego`: the observer, its team mates, the opponents."""
    return np.asarray([[drone, *others] for drone, others in enumerate(others_of(sides))], np.int32)


def world_fields(sides: Sides) -> Fields:
    """The parts of `observe_team_world`: eq. 5 with numbers, such as p_d1, q_d1, p_d2, ..."""
    return _fields(drone_names(sides, _LETTERS))


def ego_fields(sides: Sides) -> Fields:
    """The parts of `observe_team_ego`: self, then mate1, ..., opponent1, ..., as far as there are."""
    opponents = sides.count(1)
    if sides.count(0) == opponents:
        others = [f"mate{i + 1}" for i in range(opponents - 1)]
        others += [f"opponent{i + 1}" for i in range(opponents)]
    else:  # who is a mate depends on the side
        others = [f"other{i + 1}" for i in range(len(sides) - 1)]
    return _fields(("self", *others))


def _fields(names: Sequence[str]) -> Fields:
    """The parts of eq. 5 with these drones, in its order."""
    return (
        *(part for name in names for part in ((f"p_{name}", 3), (f"q_{name}", 4))),
        ("p_t", 3),
        *(part for name in names for part in ((f"v_{name}", 3), (f"w_{name}", 3))),
        *((f"g_{name}", 3) for name in names),
    )


def columns_of(fields: Fields, order: NDArray[np.int32]) -> NDArray[np.int32]:
    """[A, size]: whose numbers stand in each column, by observer; the target's are the observer's.

    `fields` name the drones of `order` [A, A], in its order, behind the underscores of their parts
    (p_, q_, ...), and the target as t.
    """
    whose = [name.partition("_")[2] for name, length in fields for _ in range(length)]
    names = [who for who in dict.fromkeys(whose) if who != "t"]
    column = [0 if who == "t" else names.index(who) for who in whose]
    target = [who == "t" for who in whose]
    return np.where(target, np.arange(len(order))[:, None], order[:, column])


def observe_team_world(sides: Sides, drones: Drones, target: jax.Array) -> jax.Array:
    """Observation [A, 16 A + 3], for two drones that of eq. 5.

    Positions and quaternions in the world frame; velocities, rates and unit gravity in each drone's
    body frame; drones in the order of `world_order`. `drones` fields are [A, ...], `target` [3] m.
    """
    down = jnp.broadcast_to(jnp.asarray(DOWN), drones.position.shape)
    velocity = rotate_inverse(drones.quaternion, drones.velocity)
    gravity = rotate_inverse(drones.quaternion, down)
    pose = jnp.concatenate([drones.position, drones.quaternion], axis=-1)
    twist = jnp.concatenate([velocity, drones.rate], axis=-1)
    order, count = world_order(sides), len(sides)
    in_order = lambda each: each[order].reshape(count, -1)
    aim = jnp.broadcast_to(target, (count, 3))
    return jnp.concatenate([in_order(pose), aim, in_order(twist), in_order(gravity)], axis=-1)


def observe_team_ego(sides: Sides, drones: Drones, target: jax.Array) -> jax.Array:
    """Observation [A, 16 A + 3], each row in the observing drone's own body frame, as
    `observe.observe_ego`: self, then team mates, then opponents.
    """
    whom, count = others_of(sides), len(sides)
    own = drones.quaternion
    into = lambda vector: rotate_inverse(own, vector)
    of_other = lambda vector: rotate_inverse(own[:, None], vector)
    gravity = into(jnp.broadcast_to(jnp.asarray(DOWN), drones.position.shape))
    position, quaternion, velocity, rate = (field[whom] for field in drones)
    flat = lambda *parts: jnp.concatenate(parts, axis=-1).reshape(count, -1)
    way = of_other(position - drones.position[:, None])
    attitude = multiply(conjugate(own)[:, None], quaternion)
    return jnp.concatenate(
        [
            drones.position,
            own,
            flat(way, attitude),
            into(target - drones.position),
            into(drones.velocity),
            drones.rate,
            flat(of_other(velocity), of_other(rotate(quaternion, rate))),
            gravity,
            flat(gravity[whom]),
        ],
        axis=-1,
    )
