"""Where a fight's drones and its target start. Plain arrays of one fight.

What does not live here: random numbers and velocities at the start (`env`).
"""

import jax
import jax.numpy as jnp

from dronecombat_jax.config.fields import GameConfig
from dronecombat_jax.config.sides import DUEL, team

# Start positions of defender, attacker and target in m (`places`); the altitudes are drawn.
START = ((0.0, 5.0), (0.0, 0.0), (5.0, 5.0))
TARGET = 2  # its row
ARENA_HALF_WIDTH = 5.0
# A start anywhere lies in this box, m: a metre around the starts of both sides and the target.
ANYWHERE_LOW, ANYWHERE_HIGH = (-1.0, -1.0, 0.8), (6.0, 6.0, 5.0)


def start_positions(game: GameConfig, numbers: jax.Array) -> jax.Array:
    """Positions [A + 1, 3] m of the drones, then of the target, from uniform `numbers` [A + 1, 3].

    Each drone of a team is drawn on its own, about its place in a row along x through the side's
    start; then those that are nearer than `game.team_spacing` along x are moved apart.
    """
    places = (*game.sides, TARGET)
    altitude = game.spawn_altitude_low + numbers[:, 2] * (
        game.spawn_altitude_high - game.spawn_altitude_low
    )
    offset = 2.0 * numbers[:, :2] - 1.0
    spreads = max(game.spawn_spread, game.defender_spread), game.spawn_spread, game.spawn_spread
    spread = [[spreads[place]] for place in places]
    plane = jnp.asarray(_rows(game)) + jnp.asarray(spread) * offset
    if game.spawn == "uniform":
        plane = ARENA_HALF_WIDTH * offset
    for side in DUEL:
        if game.sides.count(side) > 1:
            mates = team(game.sides, side)
            plane = plane.at[mates, 0].set(apart(plane[mates, 0], game.team_spacing))
    return jnp.concatenate([plane, altitude[:, None]], axis=-1)


def start_anywhere(speed: float, numbers: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Positions [A, 3] m and velocities [A, 3] m/s, world frame, of drones that start anywhere in the
    arena, from uniform `numbers` [A, 6]; up to `speed` along each axis.
    """
    low, high = jnp.asarray(ANYWHERE_LOW), jnp.asarray(ANYWHERE_HIGH)
    return low + (high - low) * numbers[:, :3], speed * (2.0 * numbers[:, 3:] - 1.0)


def apart(x: jax.Array, spacing: float) -> jax.Array:
    """The places `x` [n] with at least `spacing` between any two, in the order they were in.

    The first stays, and each other moves up as little as the ones before it make it.
    """
    order = jnp.argsort(x)
    steps = spacing * jnp.arange(x.shape[0], dtype=x.dtype)
    return jnp.zeros_like(x).at[order].set(jax.lax.cummax(x[order] - steps) + steps)


def places(game: GameConfig) -> tuple[tuple[float, float], ...]:
    """Where defenders, attackers and target start, (x, y) in m, before anything is drawn."""
    (x, y), *others = START
    return (x - game.defender_setback, y), *others


def _rows(game: GameConfig) -> list[tuple[float, float]]:
    """[A + 1, 2] m: team mates in a row along x about the side's start, then the target."""
    rows = []
    for drone, side in enumerate(game.sides):
        mates = team(game.sides, side)
        middle = (mates.start + mates.stop - 1) / 2.0
        x, y = places(game)[side]
        rows.append((x + game.team_spacing * (drone - middle), y))
    return [*rows, START[TARGET]]
