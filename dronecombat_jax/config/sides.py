"""Which side each drone of a fight is on, and what it is called.

Drones are in one order everywhere: all defenders, then all attackers. So are those who learn, sides or
single drones. What does not live here: whose policy a drone flies (`learn.mates`). Nothing imports JAX.
"""

from collections.abc import Sequence
from typing import NamedTuple

from dronecombat_jax.config.opponents import SIDES as NAMES
from dronecombat_jax.errors import UserError

Sides = tuple[int, ...]  # the side of each drone: 0 the defender's, 1 the attacker's
DUEL: Sides = (0, 1)
MAX_TEAM = 8


class Pupil(NamedTuple):
    """One who learns: a side with all its drones, or one of them (`learn.mates`)."""

    name: str  # the side's, or the drone's as of `drone_names`
    side: int
    drones: slice  # whose steps it learns from, among all drones of the fight
    number: int = 0  # among those of its side who learn


def sides_of(defenders: int, attackers: int) -> Sides:
    """The side of each drone."""
    return (0,) * defenders + (1,) * attackers


def team(sides: Sides, side: int) -> slice:
    """The drones of one side: its team."""
    first = sides.index(side)
    return slice(first, first + sides.count(side))


def mates(sides: Sides, side: int) -> range:
    """The same, drone by drone."""
    return range(len(sides))[team(sides, side)]


def drone_names(sides: Sides, of_side: Sequence[str] = NAMES, gap: str = "") -> tuple[str, ...]:
    """The drones' names: `defender` where it flies alone, else `defender1`, `defender2`, ...

    `of_side`: what a drone of each side is called; `gap` stands before its number.
    """
    names = []
    for drone, side in enumerate(sides):
        number = f"{gap}{drone - team(sides, side).start + 1}"
        names.append(of_side[side] + (number if sides.count(side) > 1 else ""))
    return tuple(names)


def pupils_of(sides: Sides, mates: str) -> tuple[Pupil, ...]:
    """Who learns, in the order of all learners: each side, or with `mates` "own" each drone."""
    if mates != "own":
        return tuple(Pupil(name, side, team(sides, side)) for side, name in enumerate(NAMES))
    return tuple(
        Pupil(name, side, slice(drone, drone + 1), drone - team(sides, side).start)
        for drone, (name, side) in enumerate(zip(drone_names(sides), sides, strict=True))
    )


def require_duel(sides: Sides, what: str) -> None:
    """UserError where `what` is made for one drone a side and more fly."""
    if sides != DUEL:
        raise UserError(f"{what} is made for one drone a side, not {spelt(sides)}")


def spelt(sides: Sides) -> str:
    """The sizes of both sides in words, such as "2 against 1": defenders, then attackers."""
    return f"{sides.count(0)} against {sides.count(1)}"
