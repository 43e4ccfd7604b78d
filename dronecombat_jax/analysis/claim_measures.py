"""One number a training seed for each of the paper's claims (`claims`).

A run's own map: its defenders against its own attackers, each policy once. Times are shares of the
training, so that runs of any length are measured alike. A seed whose map has missing cells is left
out: nothing is made up.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from dronecombat_jax.analysis.bradley_terry import POINTS, bradley_terry
from dronecombat_jax.analysis.forgetting import run_maps
from dronecombat_jax.analysis.result import (
    Entrant,
    TournamentResult,
    by_training,
    score_rate,
    scores,
    select,
    showings,
    win_rate,
)
from dronecombat_jax.types import ATTACKER, DEFENDER

SAME_TIME = 0.1  # of the training: near the diagonal
LATE = 0.6  # the paper's 600 of 1000 million steps
MIDDLE = 0.3  # from here to LATE is what late defenders are compared with
EARLY = 0.5


class OwnMap(NamedTuple):
    """A run by itself: R defenders, C attackers, each policy once."""

    part: TournamentResult  # [R, C]
    defender_time: NDArray[np.float64]  # [R] share of the training done
    attacker_time: NDArray[np.float64]  # [C]


def own_maps(result: TournamentResult, method: str) -> list[OwnMap]:
    """The own maps of `method`, one for each seed whose map is complete."""
    sides = by_training(result.defenders), by_training(result.attackers)
    maps = []
    for lineage, saved in sides[DEFENDER].items():
        if saved[0][1].method != method or lineage not in sides[ATTACKER]:
            continue
        (rows, row_time), (columns, column_time) = (_once(side[lineage]) for side in sides)
        part = select(result, rows, columns)
        if part.played.all():
            maps.append(OwnMap(part, row_time, column_time))
    return maps


def attackers_ahead(
    result: TournamentResult, own_elo: Mapping[str, NDArray[Any]], method: str
) -> NDArray[np.float64]:
    """[S] mean Elo of a run's attackers minus its defenders', over all chunks, in its own pool."""
    sides = by_training(result.defenders), by_training(result.attackers)
    first = len(result.defenders)
    values = []
    for lineage, saved in sides[DEFENDER].items():
        if saved[0][1].method == method and lineage in own_elo:
            elo = own_elo[lineage]
            attackers = [elo[first + index] for index, _ in sides[ATTACKER].get(lineage, ())]
            defenders = [elo[index] for index, _ in saved]
            values.append(np.mean(attackers) - np.mean(defenders) if attackers else np.nan)
    return _finite(values)


def final_own_elo(
    result: TournamentResult, own_elo: Mapping[str, NDArray[Any]], method: str
) -> NDArray[np.float64]:
    """[S] Elo of a run's final defender in its own pool: the paper's 1350 and 1450."""
    finals = {
        lineage: saved[-1]
        for lineage, saved in by_training(result.defenders).items()
        if saved[-1][1].method == method and lineage in own_elo
    }
    return _finite([own_elo[lineage][index] for lineage, (index, _) in finals.items()])


def near_the_diagonal(result: TournamentResult, method: str) -> NDArray[np.float64]:
    """[S] mean score beyond what ratings predict: attackers of the defender's time minus others.

    The ratings are those of the run's own map (Bradley-Terry), so that nothing is left of how
    strong either policy is.
    """
    values = []
    for own in own_maps(result, method):
        table = scores(own.part)
        rating = bradley_terry(table.wins, table.losses, table.ties).rating
        size = len(own.part.defenders)
        expected = expit((rating[:size, None] - rating[None, size:]) / POINTS)
        beyond = score_rate(own.part) - expected
        near = np.abs(own.defender_time[:, None] - own.attacker_time) <= SAME_TIME + 1e-9
        values.append(_mean(beyond[near]) - _mean(beyond[~near]))
    return _finite(values)


def late_decline(result: TournamentResult, method: str) -> NDArray[np.float64]:
    """[S] win rate against attackers up to LATE: defenders from MIDDLE to LATE minus later ones."""
    values = []
    for own in own_maps(result, method):
        rate = win_rate(own.part)[:, own.attacker_time <= LATE + 1e-9]
        late = own.defender_time > LATE + 1e-9
        middle = (own.defender_time > MIDDLE + 1e-9) & ~late
        values.append(_mean(rate[middle]) - _mean(rate[late]))
    return _finite(values)


def own_past(result: TournamentResult, method: str) -> NDArray[np.float64]:
    """[S] win rate of the final defender against its own run's attackers up to EARLY."""
    maps = own_maps(result, method)
    return _finite(
        [_mean(win_rate(own.part)[-1, own.attacker_time <= EARLY + 1e-9]) for own in maps]
    )


def early_part(result: TournamentResult) -> TournamentResult:
    """The tournament with only those trained attackers that were saved in the first half of their
    training.
    """
    last = {lineage: saved[-1][1].chunk for lineage, saved in by_training(result.attackers).items()}
    early = sorted(
        {
            index
            for index, entrant in showings(result.attackers)
            if entrant.lineage and entrant.chunk <= EARLY * last[entrant.lineage]
        }
    )
    everyone = np.arange(len(result.defenders))
    return select(result, everyone, np.asarray(early, int))


def distance_from_median(result: TournamentResult, method: str) -> NDArray[np.float64]:
    """[S] mean over the own map's cells of |win rate - median over the method's seeds|."""
    maps = [
        run_map.score for run_map in run_maps(result, win_rate(result)) if run_map.method == method
    ]
    if not maps:
        return np.zeros(0)
    stack = np.stack(maps)
    cells = stack[:, ~np.isnan(stack).any(axis=0)]
    if not cells.size:
        return np.zeros(0)
    return np.abs(cells - np.median(cells, axis=0)).mean(axis=1)


def _once(saved: list[tuple[int, Entrant]]) -> tuple[NDArray[np.integer], NDArray[np.float64]]:
    """Each policy of a run where it was first saved: its index, and the share of the training."""
    last = max(saved[-1][1].chunk, 1)
    first: dict[int, float] = {}
    for index, entrant in saved:
        first.setdefault(index, entrant.chunk / last)
    return np.asarray(list(first), int), np.asarray(list(first.values()))


def _mean(values: NDArray[Any]) -> float:
    return float(values.mean()) if values.size else float("nan")


def _finite(values: list[Any]) -> NDArray[np.float64]:
    known = np.asarray(values, float)
    return known[np.isfinite(known)]
