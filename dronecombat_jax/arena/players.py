"""Who takes part in a round robin: players of one side, and those of them whom one program can fly.

What does not live here: where they come from (`runs`), how they are flown (`lanes`).
"""

import hashlib
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.combat.observe import layout_of
from dronecombat_jax.combat.scripted import PILOTS, PLANNERS, TEAMWORK
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.learn.mates import of_mate
from dronecombat_jax.learn.memory import memory_size
from dronecombat_jax.types import SIDES, SidePolicy, TeamPolicy


class Player(NamedTuple):
    """One entrant on one side, ready to fly."""

    # digest of its parameters, or the scripted pilot's name; its random numbers depend on it
    identity: str
    # NumPy leaves without leading axes, log-std in its bounds; or the name of a scripted pilot
    pilot: SidePolicy | str
    normalize: bool = True  # whether the policy sees scaled observations
    observation: str = ""  # the layout that it sees, of `OBSERVATIONS`; "": that of the game flown


_TEAMS = "teams"  # the group of scripted pilots that fly as teams


class Kind(NamedTuple):
    """What one program can fly on one side."""

    sizes: tuple[int, ...]  # of the policies' networks, from observation to action; (): no policies
    normalize: bool  # whether they see scaled observations
    scripted: bool  # scripted pilots fly among them
    observation: str = ""  # what the policies see, as in `Player`
    memory: int = 0  # numbers that the policies remember of a fight
    others: int = 0  # units of their layer for slots of others (`types.Encoder`); 0: none
    recurrent: bool = False  # they remember by a GRU (`types.GRU`), not by frames
    mates: int = 0  # policies of a side whose drones each have one; 0: one for all
    plans: bool = False  # the side's planner flies, and nobody else
    teams: bool = False  # scripted pilots of `TEAMWORK` fly, and nobody else


def alike(players: Sequence[Player]) -> list[list[int]]:
    """Indices of players by network; scripted pilots join the first, so that they need no program
    of their own. A planner has one, since it is far dearer than the others, and so have the pilots
    that fly as teams.
    """
    groups: dict[Any, list[int]] = {}
    for index, player in enumerate(players):
        group = player.pilot if _plans(player) else _TEAMS if _in_team(player) else _network(player)
        groups.setdefault(group, []).append(index)
    scripted = groups.pop(None, [])
    apart = [groups.pop(name) for name in (*PLANNERS.values(), _TEAMS) if name in groups]
    first, *others = list(groups.values()) or [[]]
    together = sorted([*first, *scripted])
    return [*([together] if together or not apart else []), *others, *apart]


def kind_of(players: Sequence[Player]) -> Kind:
    """What a program must be able to fly for players who are `alike`."""
    networks = {_network(player) for player in players}
    sizes, normalize, *more = next(filter(None, networks), ((), False))
    kind = Kind(sizes, normalize, None in networks, *more)
    return kind._replace(plans=any(map(_plans, players)), teams=any(map(_in_team, players)))


def stack(players: Sequence[Player]) -> SidePolicy | None:
    """The policies of players who are `alike`, leaves [P, ...]; None without any.

    In the place of a scripted pilot stands some policy, which never flies.
    """
    policies = [player.pilot for player in players if not isinstance(player.pilot, str)]
    if not policies:
        return None
    filled = [policies[0] if isinstance(player.pilot, str) else player.pilot for player in players]
    return jax.tree.map(lambda *leaves: np.stack(leaves), *filled)


def scripted_numbers(players: Sequence[Player], role: int) -> NDArray[np.int32]:
    """The number of each scripted pilot among `names_flown`, -1 for a policy; [P]."""
    names = names_flown(kind_of(players), role)
    return np.asarray(
        [names.index(player.pilot) if isinstance(player.pilot, str) else -1 for player in players],
        np.int32,
    )


def names_flown(kind: Kind, role: int) -> list[str]:
    """The scripted pilots of a side that one program can fly."""
    if kind.plans:
        return [PLANNERS[role]]
    return list((TEAMWORK if kind.teams else PILOTS)[role])


def refuse_other_shape(
    label: str, role: int, pilot: SidePolicy | str, config: Config, layout: str = ""
) -> None:
    """Raise UserError 3 where a policy sees more or fewer numbers than the game of `config` shows, or
    its side has more or fewer drones.

    `layout`: the observation that it is shown, where that is not the game's own.
    """
    if isinstance(pilot, str):
        return
    flying = config.game.sides.count(role)
    if isinstance(pilot, TeamPolicy) and len(pilot.mates) != flying:
        raise UserError(
            f"{one_line(label)} is {len(pilot.mates)} {SIDES[role]}s with a policy each, and this game "
            f"has {flying}: it cannot fly here",
            EXIT_DATA,
        )
    wanted = of_mate(pilot, 0).observation_scaler.mean.shape[-1]
    name = layout or config.game.observation
    if wanted != (shown := layout_of(name, config.game).size):
        raise UserError(
            f"{one_line(label)} sees {wanted} numbers, and observation {one_line(name)} of this game "
            f"has {shown}: it cannot fly here",
            EXIT_DATA,
        )


def content_words(identity: str) -> NDArray[np.uint32]:
    """Two 32-bit words [2] of a player's identity, for its keys."""
    return np.frombuffer(hashlib.sha256(identity.encode()).digest()[:8], "<u4").astype(np.uint32)


def _plans(player: Player) -> bool:
    return isinstance(player.pilot, str) and player.pilot in PLANNERS.values()


def _in_team(player: Player) -> bool:
    return isinstance(player.pilot, str) and any(player.pilot in laws for laws in TEAMWORK.values())


def _network(player: Player) -> tuple[Any, ...] | None:
    """Widths of its network, whether it normalises, what it sees, how much it remembers, units of
    its encoder of others, whether it has a GRU, and how many policies it is; None for a scripted
    pilot.
    """
    if isinstance(player.pilot, str):
        return None
    policy = of_mate(player.pilot, 0)
    mates = len(player.pilot.mates) if isinstance(player.pilot, TeamPolicy) else 0
    network, size = policy.network, policy.observation_scaler.mean.shape[0]
    sizes = size, *(weight.shape[1] for weight in network.weights)
    others = 0 if network.others is None else network.others.biases.shape[-1]
    memory = memory_size(policy)
    recurrent = policy.gru is not None
    return sizes, player.normalize, player.observation, memory, others, recurrent, mates
