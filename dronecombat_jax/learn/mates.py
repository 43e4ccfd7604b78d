"""Whose policy a drone flies: the one that it shares with its team mates, or its own (`learn.mates`).

A side that learns as a whole, or has one drone, has a plain `Policy`, any other a `TeamPolicy`; all
else asks here. Who learns is read from the settings (`config.sides`). What does not live here:
learning (`algorithms`).
"""

from collections.abc import Callable

from dronecombat_jax.config.sides import Pupil, Sides, team
from dronecombat_jax.errors import UserError
from dronecombat_jax.types import ATTACKER, DEFENDER, Policy, SidePolicy, TeamPolicy

Both = tuple[SidePolicy, SidePolicy]  # the defender's side, the attacker's


def of_side(pupils: tuple[Pupil, ...], side: int, of_pupil: Callable[[int], Policy]) -> SidePolicy:
    """The policy of `side`, `of_pupil` giving that of each who learns, by its index."""
    own = [of_pupil(index) for index, pupil in enumerate(pupils) if pupil.side == side]
    return own[0] if len(own) == 1 else TeamPolicy(tuple(own))


def by_side(pupils: tuple[Pupil, ...], of_pupil: Callable[[int], Policy]) -> Both:
    """The same of both sides."""
    return of_side(pupils, DEFENDER, of_pupil), of_side(pupils, ATTACKER, of_pupil)


def of_mate(policy: SidePolicy, number: int) -> Policy:
    """What the drone `number`, from 0 in its team, flies of its side's policy."""
    return policy.mates[number] if isinstance(policy, TeamPolicy) else policy


def of_drone(policy: SidePolicy, sides: Sides, drone: int) -> Policy:
    """The same for `drone` among all drones of the fight."""
    return of_mate(policy, drone - team(sides, sides[drone]).start)


def only(policy: SidePolicy, what: str) -> Policy:
    """The one policy of a side. UserError 2 where each drone has its own, which `what` has no room
    for.
    """
    if isinstance(policy, TeamPolicy):
        raise UserError(
            f"{what} has room for one policy, and each of {len(policy.mates)} team mates has its own: "
            "dronecombat export RUN --drone 2 FILE takes that of the second"
        )
    return policy
