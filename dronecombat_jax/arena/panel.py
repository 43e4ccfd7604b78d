"""One number a training seed: its final defender's mean score against attackers that it never trained with.

Fixed beforehand: the panel is the final and every tenth attacker of all runs, and the scripted pilots; a run's own
attackers do not count for it. Every attacker weighs the same.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.arena.result import Entrant, TournamentResult, score_rate


class Panel(NamedTuple):
    """Final defenders of R runs against G groups of attackers; a group is one run's, or one scripted pilot."""

    runs: tuple[str, ...]  # [R] `Entrant.lineage`: one seed of a run each
    methods: tuple[str, ...]  # [R]
    seeds: tuple[int, ...]  # [R]
    steps: tuple[int, ...]  # [R] trained; unequal ones are compared as they are
    score: NDArray[np.float64]  # [R] mean score away
    adjusted: NDArray[np.float64]  # [R] the same, as if all had met all: see `additive_scores`
    fights: NDArray[np.integer]  # [R] behind it
    table: NDArray[np.float64]  # [R, G] mean score by group; NaN at home
    groups: tuple[str, ...]  # [G] run, or "" for a scripted pilot
    group_methods: tuple[str, ...]  # [G]
    weights: NDArray[np.float64]  # [G] attackers in it
    missing: tuple[tuple[str, str], ...]  # (run, method) left out: the final defender did not play half of the panel
    dropped: tuple[str, ...]  # identities of panel attackers that some remaining defender did not meet


def away_panel(result: TournamentResult, every: int = 10) -> Panel:
    """Score every run's final defender; `every`: which chunks of the attackers sit on the panel beside the final one.

    Nothing missing is made up. A defender that did not play half of the panel is left out and named in `missing`;
    then attackers that did not meet all the others are left out, so that the panel stays common.
    """
    finals = list(_finals(result.defenders).values())
    seats = _seats(result.attackers, every)
    rate = score_rate(result)[np.ix_(finals, seats)]
    own = np.asarray([[_home(result, row, seat) for seat in seats] for row in finals], bool).reshape(rate.shape)
    absent = np.isnan(rate) & ~own
    whole = absent.mean(axis=1) < 0.5 if len(seats) else np.zeros(len(finals), bool)
    met = ~absent[whole].any(axis=0)
    missing = tuple((result.defenders[row].lineage, result.defenders[row].method) for row in np.asarray(finals)[~whole])
    dropped = tuple(result.attackers[seat].identity for seat in np.asarray(seats)[~met])
    rows = [result.defenders[row] for row, keep in zip(finals, whole, strict=True) if keep]
    players = [result.attackers[seat] for seat, keep in zip(seats, np.atleast_1d(met), strict=True) if keep]
    cells = np.where(own, np.nan, rate)[np.ix_(whole, met)]
    names = sorted({_group(player) for player in players})
    member = np.asarray([[_group(player) == name for player in players] for name in names]).reshape(len(names), -1)
    weights = member.sum(axis=1).astype(float)
    away = ~np.isnan(cells)
    table = _average(cells, member)
    return Panel(
        runs=tuple(row.lineage for row in rows),
        methods=tuple(row.method for row in rows),
        seeds=tuple(row.seed for row in rows),
        steps=tuple(row.steps for row in rows),
        score=_average(cells, np.ones((1, len(players)), bool))[:, 0],
        adjusted=additive_scores(table, weights),
        fights=away.sum(axis=1) * result.cause.shape[2],
        table=table,
        groups=tuple(run for run, _, _ in names),
        group_methods=tuple(method for _, method, _ in names),
        weights=weights,
        missing=missing,
        dropped=dropped,
    )


def additive_scores(table: NDArray, weights: NDArray) -> NDArray[np.float64]:
    """Row effects [R] of the least-squares fit row + column to `table` [R, G], at the mean column; NaN cells are left out.

    A run never meets its own attackers, so of two methods with n runs each the plain mean favours the one with the
    stronger attackers, by the difference that these make over (2 n - 1); this one does not.
    """
    rows, columns = np.nonzero(~np.isnan(table))
    size, groups = table.shape
    design = np.zeros((len(rows), size + groups))
    design[np.arange(len(rows)), rows] = 1.0
    design[np.arange(len(rows)), size + columns] = 1.0
    root = np.sqrt(weights[columns])
    effects = np.linalg.lstsq(design * root[:, None], table[rows, columns] * root, rcond=None)[0]
    return effects[:size] + effects[size:] @ weights / weights.sum() if len(rows) else np.full(size, np.nan)


def _finals(entrants: tuple[Entrant, ...]) -> dict[str, int]:
    """The index of each run's last entrant, in order of run."""
    last: dict[str, int] = {}
    for index, entrant in enumerate(entrants):
        run = entrant.lineage
        if run and (run not in last or entrant.chunk > entrants[last[run]].chunk):
            last[run] = index
    return dict(sorted(last.items()))


def _seats(entrants: tuple[Entrant, ...], every: int) -> list[int]:
    final = set(_finals(entrants).values())
    tenth = lambda entrant: entrant.chunk > 0 and entrant.chunk % every == 0
    seats = [index for index, one in enumerate(entrants) if not one.lineage or index in final or tenth(one)]
    return sorted(seats, key=lambda index: entrants[index].identity)


def _group(player: Entrant) -> tuple[str, str, str]:
    return (player.lineage, player.method, "" if player.lineage else player.identity)


def _home(result: TournamentResult, row: int, seat: int) -> bool:
    return result.attackers[seat].lineage == result.defenders[row].lineage


def _average(cells: NDArray, member: NDArray) -> NDArray[np.float64]:
    """Mean [R, G] of `cells` [R, P] over each group's members [G, P]; NaN cells are left out."""
    away = ~np.isnan(cells)
    total = np.where(away, cells, 0.0) @ member.T
    count = away.astype(float) @ member.T
    return np.where(count > 0, total / np.maximum(count, 1.0), np.nan)
