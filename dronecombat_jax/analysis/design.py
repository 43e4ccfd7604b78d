"""Which ratings a set of fights can determine: who is linked to whom, and who was never beaten.

Players are numbered defenders first, then attackers: P = D + A.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from dronecombat_jax.analysis.result import TournamentResult, select

BOUNDED = 0
OPEN_ABOVE = 1  # nothing limits the rating from above: unbeaten, or in a group unbeaten by the rest
OPEN_BELOW = -1
OPEN_BOTH = 2


class Design(NamedTuple):
    """What the fights can tell about each of P players."""

    # [P] players of different numbers never met, even through others: not comparable
    component: NDArray[np.integer]
    bound: NDArray[np.integer]  # [P] BOUNDED, OPEN_ABOVE, OPEN_BELOW or OPEN_BOTH
    games: NDArray[np.float64]  # [P]


def design_of(wins: NDArray[Any], losses: NDArray[Any], ties: NDArray[Any] | None = None) -> Design:
    """Examine the fights of D defenders with A attackers, counted from the defender's side in three
    [D, A].

    A finite maximum of the likelihood exists if and only if from every player one gets to every
    other by a chain of "did not always lose to" (Ford 1957). Otherwise the largest group within
    which that holds is the reference, and the players above and below it are bounded on one side
    only; without one largest group no player is a reference.
    """
    ties = np.zeros_like(wins) if ties is None else ties
    num_defenders, num_attackers = wins.shape
    total = num_defenders + num_attackers
    beats = np.zeros((total, total), bool)
    beats[:num_defenders, num_defenders:] = (wins + ties) > 0
    beats[num_defenders:, :num_defenders] = ((losses + ties) > 0).T
    graph = csr_array(beats)
    component = connected_components(graph, directed=False)[1]
    group = connected_components(graph, directed=True, connection="strong")[1]
    bound = np.zeros(total, int)
    for part in np.unique(component):
        members = np.flatnonzero(component == part)
        if len(members) == 1:
            bound[members] = OPEN_BOTH  # never fought
        elif len(np.unique(group[members])) > 1:
            bound[members] = _bounds(graph, beats, members, group[members])
    games = wins + losses + ties
    return Design(
        component, bound, np.concatenate([games.sum(axis=1), games.sum(axis=0)]).astype(float)
    )


def _bounds(
    graph: csr_array, beats: NDArray[Any], members: NDArray[Any], group: NDArray[Any]
) -> NDArray[np.integer]:
    names, sizes = np.unique(group, return_counts=True)
    largest = names[sizes == sizes.max()]
    if len(largest) > 1:
        # no reference: each is bounded only by the groups that it leads to or comes from
        leads = np.asarray(
            [
                beats[member, members[group != own]].any()
                for member, own in zip(members, group, strict=True)
            ]
        )
        follows = np.asarray(
            [
                beats[members[group != own], member].any()
                for member, own in zip(members, group, strict=True)
            ]
        )
        for name in names:
            leads[group == name], follows[group == name] = (
                leads[group == name].any(),
                follows[group == name].any(),
            )
    else:
        inside = members[group == largest[0]]
        leads = np.isin(members, breadth_first_order(graph.T, inside[0], return_predecessors=False))
        follows = np.isin(members, breadth_first_order(graph, inside[0], return_predecessors=False))
        leads |= group == largest[0]
        follows |= group == largest[0]
    bound = np.full(len(members), OPEN_BOTH)
    bound[leads & follows & (len(largest) == 1)] = BOUNDED
    bound[leads & ~follows] = OPEN_ABOVE
    bound[~leads & follows] = OPEN_BELOW
    return bound


def complete_part(result: TournamentResult) -> TournamentResult:
    """The part of a tournament in which every cell was played, for the statistics that need a whole
    matrix.

    Nothing is made up: the entrant that lacks the largest share of its cells is left out, one by
    one; of equals an attacker first, then the first by identity. What is left may be empty.
    """
    sides = [result.defenders, result.attackers]
    kept = [np.arange(len(entrants)) for entrants in sides]
    while all(map(len, kept)) and not (played := result.played[np.ix_(*kept)]).all():
        share = [np.mean(~played, axis=1), np.mean(~played, axis=0)]
        side = int(share[1].max() >= share[0].max())
        worst = np.flatnonzero(share[side] == share[side].max())
        out = min(worst, key=lambda index: sides[side][kept[side][index]].identity)
        kept[side] = np.delete(kept[side], out)
    return select(result, *kept)
