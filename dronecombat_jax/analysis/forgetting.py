"""Does the final policy still beat the opponents of its past? Each run's matches against its own
and others' past.

W [T, T] is a learner's mean score by time of saving (rows) against opponents by time of saving
(columns), NaN where not played; a cell that is NaN is left out and never filled. For attackers as
the learner, hand in 1 - W.T.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.analysis.panel import Panel
from dronecombat_jax.analysis.result import Entrant, TournamentResult, by_training, score_rate


class RunMap(NamedTuple):
    """One run's defenders against its own attackers."""

    run: str  # `Entrant.lineage`: one seed of a run
    method: str
    seed: int
    chunks: NDArray[np.integer]  # [T] common to all maps that were made together
    score: NDArray[np.float64]  # [T, T] defender's mean score; NaN where not played


class MapSummary(NamedTuple):
    """Runs of one method side by side, as in the paper's figures 6 to 9."""

    mean: NDArray[np.float64]  # [T, T] over runs; NaN where none played
    variance: NDArray[np.float64]  # [T, T] over runs, ddof 1; NaN where fewer than two played
    runs: NDArray[np.integer]  # [T, T] how many runs played the cell


class Forgetting(NamedTuple):
    """How one learner fares against its opponents' past. Scores: 1 a win, 1/2 a tie."""

    # [2 T - 1] learner's time minus opponent's: above 0 is the past, below 0 the future
    lag: NDArray[np.integer]
    profile: NDArray[np.float64]  # [2 T - 1] mean score over all pairs of that lag; NaN without any
    pairs: NDArray[np.integer]  # [2 T - 1] how many pairs
    # mean over i < T of W[T, i] - W[i, i]: below 0, the final policy lost what it could
    backward_transfer: float
    # [T] min over i <= t of W[t, i]; the noise of few fights pulls it down
    worst_past: NDArray[np.float64]
    final_worst: float  # its last entry


class AtHome(NamedTuple):
    """A final defender against its own run's attackers, less what strengths explain.

    Raw scores at home tell of the attackers, too: of equal defenders the one with the weaker
    attackers looks better there.
    """

    advantage: float  # mean score beyond both strengths: does it know them by heart?
    worst: float  # the least score, were all attackers as strong as the panel's mean


def run_maps(result: TournamentResult, rate: NDArray[Any] | None = None) -> tuple[RunMap, ...]:
    """The map of every run that has both roles in the tournament, on one common grid of chunks.

    `rate` [D, A] defaults to the defender's mean score; `result.win_rate` gives the paper's maps.
    """
    rate = score_rate(result) if rate is None else rate
    defenders, attackers = by_training(result.defenders), by_training(result.attackers)
    runs = [run for run in defenders if run in attackers]
    chunks = np.unique(
        [
            entrant.chunk
            for side in (defenders, attackers)
            for run in runs
            for _, entrant in side[run]
        ]
    )
    maps = []
    for run in runs:
        score = np.full((len(chunks), len(chunks)), np.nan)
        indices, places = zip(
            *(_places(side[run], chunks) for side in (defenders, attackers)), strict=True
        )
        score[np.ix_(*places)] = rate[np.ix_(*indices)]
        entrant = defenders[run][0][1]
        maps.append(RunMap(run, entrant.method, entrant.seed, chunks, score))
    return tuple(maps)


def summarise_maps(maps: Sequence[RunMap]) -> MapSummary:
    """Mean and variance over runs, cell by cell, of those that played it."""
    stack = np.stack([run_map.score for run_map in maps])
    played = ~np.isnan(stack)
    runs = played.sum(axis=0)
    mean = np.where(
        runs > 0, np.where(played, stack, 0.0).sum(axis=0) / np.maximum(runs, 1), np.nan
    )
    squares = np.where(played, (stack - mean) ** 2, 0.0).sum(axis=0)
    return MapSummary(mean, np.where(runs > 1, squares / np.maximum(runs - 1, 1), np.nan), runs)


def forgetting(score: NDArray[Any]) -> Forgetting:
    """Summarise W = `score` [T, T]; raises ValueError unless it is square."""
    score = np.asarray(score, float)
    size = len(score)
    if score.shape != (size, size) or not size:
        raise ValueError(f"a map of one run is square, not {score.shape}")
    lags = np.arange(-(size - 1), size)
    diagonals = [np.diagonal(score, -lag) for lag in lags]
    diagonals = [values[~np.isnan(values)] for values in diagonals]
    transfer = score[-1, :-1] - np.diagonal(score)[:-1]
    past = np.where(np.tri(size, dtype=bool) & ~np.isnan(score), score, np.inf).min(axis=1)
    worst = np.where(np.isfinite(past), past, np.nan)
    return Forgetting(
        lag=lags,
        profile=np.asarray([_mean(values) for values in diagonals]),
        pairs=np.asarray([len(values) for values in diagonals], dtype=int),
        backward_transfer=_mean(transfer[~np.isnan(transfer)]),
        worst_past=worst,
        final_worst=float(worst[-1]),
    )


def home_and_away(result: TournamentResult, run: str) -> tuple[float, float]:
    """Mean score of a run's last defender at home, against the own attackers, and away, against
    other runs'.

    `run` is a lineage. Each opposing run weighs the same; scripted pilots are neither. NaN where
    nobody was met.
    """
    rate = score_rate(result)[by_training(result.defenders)[run][-1][0]]
    home, away = [], []
    for other, members in by_training(result.attackers).items():
        met = rate[np.unique([index for index, _ in members])]
        met = met[~np.isnan(met)]
        if len(met):
            (home if other == run else away).append(met.mean())
    return _mean(np.asarray(home)), _mean(np.asarray(away))


def at_home(result: TournamentResult, panel: Panel) -> dict[str, AtHome]:
    """For every run of `panel` that met own attackers which another run met, too."""
    trainings = by_training(result.attackers)
    finals = [by_training(result.defenders)[run][-1][0] for run in panel.runs]
    rate = score_rate(result)[finals]
    away = rate.copy()
    for row, run in enumerate(panel.runs):
        away[row, [index for index, _ in trainings.get(run, ())]] = np.nan
    # How much easier than the panel's mean an attacker is, by the defenders that it does not know.
    beyond = away - panel.adjusted[:, None]
    ease = np.asarray([_mean(column[~np.isnan(column)]) for column in beyond.T])
    fates = {}
    for row, run in enumerate(panel.runs):
        members = np.unique([index for index, _ in trainings.get(run, ())]).astype(int)
        adjusted = rate[row, members] - ease[members]
        adjusted = adjusted[~np.isnan(adjusted)]
        if len(adjusted):
            advantage = _mean(adjusted) - float(panel.adjusted[row])
            # To 12 digits, as `panel.mean_scores` does.
            fates[run] = AtHome(round(advantage, 12), round(float(adjusted.min()), 12))
    return fates


def _places(
    saved: Sequence[tuple[int, Entrant]], chunks: NDArray[Any]
) -> tuple[list[int], NDArray[np.integer]]:
    """The indices of a run's players and their places on the grid of `chunks`."""
    return [index for index, _ in saved], np.searchsorted(
        chunks, [entrant.chunk for _, entrant in saved]
    )


def _mean(values: NDArray[Any]) -> float:
    return float(values.mean()) if values.size else float("nan")
