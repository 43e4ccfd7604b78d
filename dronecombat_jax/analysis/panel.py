"""One number a training seed: its final defender's mean score against attackers that it never
trained with.

Fixed beforehand: the panel is the final and every tenth attacker of all runs, and the scripted
pilots; a run's own attackers do not count for it. Every attacker weighs the same.

The number is the ADJUSTED score. In the plain mean a run of method X meets n - 1 of X's attackers
and n of Y's, a run of Y the reverse: equal defenders then differ by what the attackers differ over
2 n - 1. Here what a run did not fly, the cell against its own attackers, is predicted from the two
strengths, and the mean goes over all cells.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.analysis.result import (
    Entrant,
    TournamentResult,
    by_training,
    score_rate,
    showings,
)
from dronecombat_jax.types import ATTACKER, DEFENDER

EVERY = 10  # chunks between the attackers of a run on the panel


class Panel(NamedTuple):
    """Final defenders of R runs against G groups of attackers; a group is one run's, or one
    scripted pilot.
    """

    runs: tuple[str, ...]  # [R] `Entrant.lineage`: one seed of a run each
    methods: tuple[str, ...]  # [R]
    seeds: tuple[int, ...]  # [R]
    steps: tuple[int, ...]  # [R] trained; unequal ones are compared as they are
    adjusted: NDArray[np.float64]  # [R] mean score as if all had met all; NaN: cannot be known
    plain: NDArray[np.float64]  # [R] mean score away, tilted by whose attackers are left out
    fights: NDArray[np.integer]  # [R] behind it
    table: NDArray[np.float64]  # [R, G] mean score by group; NaN at home
    filled: NDArray[np.float64]  # [R, G] the same, at home what `fill_home` predicts
    groups: tuple[str, ...]  # [G] run, or "" for a scripted pilot
    group_methods: tuple[str, ...]  # [G]
    weights: NDArray[np.float64]  # [G] attackers in it
    # (run, method) left out: the final defender did not play half of the panel
    missing: tuple[tuple[str, str], ...]
    # identities of panel attackers that some remaining defender did not meet
    dropped: tuple[str, ...]
    # (run, run of the same final defender): no second seed
    copies: tuple[tuple[str, str], ...] = ()


def away_panel(result: TournamentResult, every: int = EVERY) -> Panel:
    """Score every run's final defender; `every`: which chunks of the attackers sit on the panel
    beside the final one.

    Nothing missing is made up. A defender that did not play half of the panel is left out and named
    in `missing`; then attackers that did not meet all the others are left out, so that the panel
    stays common. Two runs that end with the same defender are one training seen twice: the second
    is named in `copies` and does not count.
    """
    finals, copies = _different(by_training(result.defenders))
    seats = _seats(result.attackers, every)
    rows = [index for index, _ in finals]
    rate = score_rate(result)[np.ix_(rows, seats)]
    homes = _homes(result.attackers)
    own = np.asarray(
        [[final.lineage in homes[seat] for seat in seats] for _, final in finals], bool
    ).reshape(rate.shape)
    absent = np.isnan(rate) & ~own
    whole = absent.mean(axis=1) < 0.5 if len(seats) else np.zeros(len(finals), bool)
    met = ~absent[whole].any(axis=0)
    kept = [entrant for (_, entrant), keep in zip(finals, whole, strict=True) if keep]
    players = [
        result.attackers[seat] for seat, keep in zip(seats, np.atleast_1d(met), strict=True) if keep
    ]
    cells = np.where(own, np.nan, rate)[np.ix_(whole, met)]
    names = sorted({_group(player) for player in players})
    member = np.asarray([[_group(player) == name for player in players] for name in names]).reshape(
        len(names), -1
    )
    weights = member.sum(axis=1).astype(float)
    table = _average(cells, member)
    filled = fill_home(table, weights)
    return Panel(
        runs=tuple(entrant.lineage for entrant in kept),
        methods=tuple(entrant.method for entrant in kept),
        seeds=tuple(entrant.seed for entrant in kept),
        steps=tuple(entrant.steps for entrant in kept),
        adjusted=mean_scores(filled, weights),
        plain=_average(cells, np.ones((1, len(players)), bool))[:, 0],
        fights=(~np.isnan(cells)).sum(axis=1) * result.cause.shape[2],
        table=table,
        filled=filled,
        groups=tuple(run for run, _, _ in names),
        group_methods=tuple(method for _, method, _ in names),
        weights=weights,
        missing=tuple(
            (entrant.lineage, entrant.method)
            for (_, entrant), keep in zip(finals, whole, strict=True)
            if not keep
        ),
        dropped=tuple(result.attackers[seat].identity for seat in np.asarray(seats)[~met]),
        copies=copies,
    )


def cells_needed(defenders: Sequence[Entrant], attackers: Sequence[Entrant]) -> NDArray[np.bool_]:
    """The cells [D, A] that the comparison of methods, its intervals and its figures rest on.

    The final defenders against everybody (the panel; the own attackers for home minus away), every
    run against itself (forgetting, the paper's maps), the scripted defenders against final
    attackers and scripted ones (anchors).
    """
    needed = np.zeros((len(defenders), len(attackers)), bool)
    own = by_training(defenders), by_training(attackers)
    for lineage, saved in own[DEFENDER].items():
        needed[saved[-1][0]] = True
        rows, columns = ([index for index, _ in side.get(lineage, ())] for side in own)
        needed[np.ix_(rows, columns)] = True
    pilots = [
        [index for index, entrant in enumerate(side) if not entrant.lineage]
        for side in (defenders, attackers)
    ]
    last = [saved[-1][0] for saved in own[ATTACKER].values()]
    needed[np.ix_(pilots[DEFENDER], [*last, *pilots[ATTACKER]])] = True
    return needed


def cross_play_cells(
    defenders: Sequence[Entrant], attackers: Sequence[Entrant], every: int = EVERY
) -> NDArray[np.bool_]:
    """The cells [D, A] of the paper's experiment: every run against itself, all chunks, as the
    paper rates it, and all runs against each other.

    In the cross-play the scripted pilots take part, and of each run the final players and every
    n-th chunk's, so that it holds the panel of every final defender.
    """
    asked = np.zeros((len(defenders), len(attackers)), bool)
    own = by_training(defenders), by_training(attackers)
    for lineage in own[DEFENDER]:
        rows, columns = ([index for index, _ in side.get(lineage, ())] for side in own)
        asked[np.ix_(rows, columns)] = True
    asked[np.ix_(_seats(defenders, every), _seats(attackers, every))] = True
    return asked


def every_nth(entrant: Entrant, saved: Sequence[tuple[int, Entrant]], every: int) -> bool:
    """Whether `entrant` is the last of its training `saved`, or of an n-th chunk."""
    return entrant is saved[-1][1] or (entrant.chunk > 0 and entrant.chunk % every == 0)


def fill_home(table: NDArray[Any], weights: NDArray[Any]) -> NDArray[np.float64]:
    """Fill the NaN cells of `table` [R, G] by row + column, fitted with `weights` [G].

    Least squares; all NaN stay where the cells fall into parts without a fight between them. No
    method's name is used, every run and every group has a number of its own: adjusted scores stay
    as they are when runs are relabelled, and nothing that an attacker adds is left in their
    differences. Among equal methods they are exchangeable, since each run lacks its own cell alone
    (exactly so where all groups weigh the same). So the permutation test relabels adjusted scores
    as it would plain ones.
    """
    rows, columns = np.nonzero(~np.isnan(table))
    size, groups = table.shape
    design = np.zeros((len(rows), size + groups))
    design[np.arange(len(rows)), rows] = 1.0
    design[np.arange(len(rows)), size + columns] = 1.0
    root = np.sqrt(weights[columns])
    target = table[rows, columns] * root
    effects, _, rank, _ = np.linalg.lstsq(design * root[:, None], target, rcond=None)
    known = rank == size + groups - 1  # all but the one constant that rows and columns may exchange
    predicted = effects[:size, None] + effects[size:] if known else np.nan
    return np.where(np.isnan(table), predicted, table)


def mean_scores(filled: NDArray[Any], weights: NDArray[Any]) -> NDArray[np.float64]:
    """Mean [R] over all attackers of `filled` [R, G], to 12 digits: equal means are equal bits."""
    if not weights.size:
        return np.full(len(filled), np.nan)
    return np.round(filled @ weights / weights.sum(), 12)


def _different(
    trainings: dict[str, list[tuple[int, Entrant]]],
) -> tuple[list[tuple[int, Entrant]], tuple[tuple[str, str], ...]]:
    """Each run's last entrant, in order of run, and the runs that end with the same one as an
    earlier run.
    """
    first: dict[int, Entrant] = {}
    copies = []
    for lineage, saved in sorted(trainings.items()):
        index, entrant = saved[-1]
        if index in first:
            copies.append((lineage, first[index].lineage))
        else:
            first[index] = entrant
    return list(first.items()), tuple(copies)


def _seats(entrants: Sequence[Entrant], every: int) -> list[int]:
    """Indices of the scripted pilots, each run's last entrant and every n-th, in order of identity."""
    pilots = {index for index, entrant in enumerate(entrants) if not entrant.lineage}
    trained = {
        index
        for saved in by_training(entrants).values()
        for index, entrant in saved
        if every_nth(entrant, saved, every)
    }
    return sorted(pilots | trained, key=lambda index: entrants[index].identity)


def _homes(entrants: Sequence[Entrant]) -> dict[int, set[str]]:
    """The trainings in which each entrant was saved."""
    homes: dict[int, set[str]] = {}
    for index, entrant in showings(entrants):
        homes.setdefault(index, set()).add(entrant.lineage)
    return homes


def _group(player: Entrant) -> tuple[str, str, str]:
    return (player.lineage, player.method, "" if player.lineage else player.identity)


def _average(cells: NDArray[Any], member: NDArray[Any]) -> NDArray[np.float64]:
    """Mean [R, G] of `cells` [R, P] over each group's members [G, P]; NaN cells are left out."""
    away = ~np.isnan(cells)
    total = np.where(away, cells, 0.0) @ member.T
    count = away.astype(float) @ member.T
    return np.where(count > 0, total / np.maximum(count, 1.0), np.nan)
