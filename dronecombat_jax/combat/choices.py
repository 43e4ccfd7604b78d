"""What the pilots that look ahead choose among, and what they expect of the other side.

Laws of guidance with parameters, and tables of parameters to try. What does not live here: trying
them (`planner`).
"""

import itertools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.combat import guidance
from dronecombat_jax.combat.autopilot import Airframe
from dronecombat_jax.combat.guidance import Guidance, Situation, left_of, unit
from dronecombat_jax.types import ATTACKER, DEFENDER

# (airframe, situation of E fights, parameters [P], s since the plan's start) -> acceleration [E, 3]
Law = Callable[[Airframe, Situation, jax.Array, jax.Array], jax.Array]


class Choices(NamedTuple):
    """One law with the parameters to try."""

    law: Law
    parameters: NDArray[np.float32]  # [n, P]


def slip(body: Airframe, now: Situation, numbers: jax.Array, elapsed: jax.Array) -> jax.Array:
    """Rush off the way to the target, by an angle to one side, then to the other, then straight.

    `numbers`: angle rad, side rad (0: left, pi / 2: up), seconds to it, seconds to the other side.
    """
    angle, side, first, second = numbers
    way = unit(now.target - now.position)
    off = _aside(way, side)
    turned = lambda sign: jnp.cos(angle) * way + sign * jnp.sin(angle) * off
    sign = jnp.where(elapsed < first, 1.0, -1.0)
    along = jnp.where(elapsed < first + second, turned(sign), way)
    return guidance.rush(body, now.velocity, jnp.asarray(along))


def swing(body: Airframe, now: Situation, numbers: jax.Array, elapsed: jax.Array) -> jax.Array:
    """Rush at the target and swing from side to side all the way.

    `numbers`: m/s of the swing, its rate rad/s, its phase rad at the fight's start, side rad as of `slip`.
    """
    speed, rate, phase, side = numbers
    ahead = now.target - now.position
    pace = speed * jnp.cos(rate * now.time + phase)
    off = _aside(unit(ahead), side)
    return guidance.rush(body, now.velocity - pace[:, None] * off, ahead)


def _aside(way: jax.Array, side: jax.Array) -> jax.Array:
    """The unit vector [E, 3] across `way` [E, 3], `side` rad up from the left."""
    left = left_of(way)
    return jnp.cos(side) * left + jnp.sin(side) * jnp.cross(way, left)


def navigate(body: Airframe, now: Situation, numbers: jax.Array, elapsed: jax.Array) -> jax.Array:
    """Proportional navigation; `numbers`: its constant."""
    return guidance.proportional_navigation(body, now, numbers[0])


def guard(body: Airframe, now: Situation, numbers: jax.Array, elapsed: jax.Array) -> jax.Array:
    """Stand before the target; `numbers`: m from it."""
    return guidance.hover_guard(body, now, numbers[0])


def plain(law: Guidance) -> Choices:
    """A law without parameters."""
    return Choices(lambda body, now, numbers, elapsed: law(body, now), np.zeros((1, 1), np.float32))


def _slips() -> Choices:
    """To five sides by three angles for three times, and some that change sides."""
    sides = np.arange(5) * np.pi / 4
    once = itertools.product((0.6, 1.2, 1.6), sides, (0.1, 0.25, 0.5), (0.0,))
    changes = ((0.16, 0.16), (0.3, 0.2), (0.3, 0.4))
    twice = [
        (angle, side, *times) for angle in (0.8, 1.3) for side in (0.0, np.pi) for times in changes
    ]
    return Choices(slip, np.asarray([*once, *twice], np.float32))


def _swings(speeds: tuple[float, ...], phases: int) -> Choices:
    """At two rates, to the side and up and down."""
    starts = np.arange(phases) * 2.0 * np.pi / phases
    swings = itertools.product(speeds, (4.0, 6.0), starts, (0.0, np.pi / 2))
    return Choices(swing, np.asarray(list(swings), np.float32))


def _rows(*numbers: float) -> NDArray[np.float32]:
    return np.asarray(numbers, np.float32)[:, None]


_ATTACKERS = np.asarray(
    [(0.5, 0.0, 9.0, 0.0), (0.5, np.pi, 9.0, 0.0), (0.6, np.pi / 2, 9.0, 0.0)], np.float32
)
# By role: what it may do, and what the other side may do meanwhile.
OWN: dict[int, tuple[Choices, ...]] = {
    DEFENDER: (
        Choices(navigate, _rows(2.0, 3.0, 4.0, 6.0)),
        Choices(guard, _rows(0.3, 1.0, 2.0, 3.0)),
    ),
    ATTACKER: (plain(guidance.dash), plain(guidance.high_dive), _slips(), _swings((3.0, 5.0), 4)),
}
OTHER: dict[int, tuple[Choices, ...]] = {
    DEFENDER: (
        plain(guidance.dash),
        plain(guidance.weave),
        plain(guidance.high_dive),
        Choices(slip, _ATTACKERS),
        _swings((4.0,), 2),
    ),
    ATTACKER: (Choices(navigate, _rows(3.0)), Choices(guard, _rows(2.0))),
}
