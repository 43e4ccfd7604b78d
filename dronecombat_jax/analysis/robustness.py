"""What a change of the game does to players that do not know of it: loss of score, and of ranks.

Both tournaments are of the same players. Fight e starts alike in all cells of one tournament, and
in most cases in both, so that starts are the sample: what is said holds for these players. What
does not live here: which changes (`tournaments.reality`), flying them (`tournaments.robustness`).
"""

import warnings
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from dronecombat_jax.analysis.bradley_terry import bradley_terry
from dronecombat_jax.analysis.result import TournamentResult, fight_scores, scores
from dronecombat_jax.errors import EXIT_DATA, UserError

RANKED = 3  # players that a rank correlation needs


class Effect(NamedTuple):
    """How one side fares under the change; NaN where a number cannot be had."""

    role: int
    nominal: float  # mean score over the cells that were flown in both: a win 1, a tie 1/2
    score: float  # the same under the change
    loss: float  # the first minus the second
    low: float  # of the loss's 95 % interval (Student's t over the starts)
    high: float
    kendall: float  # tau-b of the side's Bradley-Terry ratings with the nominal ones
    spearman: float  # rho of the same
    players: int  # of this side
    fights: int  # under the change


def effect(nominal: TournamentResult, changed: TournamentResult, role: int) -> Effect:
    """How the players of `role` fare in `changed` against `nominal`, both of the same players.

    Raises UserError where the two have other players or numbers of fights.
    """
    if (nominal.defenders, nominal.attackers) != (changed.defenders, changed.attackers) or (
        nominal.cause.shape != changed.cause.shape
    ):
        raise UserError("the two tournaments are of other players or lengths", EXIT_DATA)
    flown = nominal.played & changed.played
    if not flown.any():
        raise UserError("no cell was flown in both tournaments", EXIT_DATA)
    before, after = (_by_start(result, flown, role) for result in (nominal, changed))
    low, high = _interval(before - after)
    ranks = [_ratings(result, flown, role) for result in (nominal, changed)]
    kendall, spearman = rank_correlations(*ranks)
    return Effect(
        role=role,
        nominal=float(before.mean()),
        score=float(after.mean()),
        loss=float((before - after).mean()),
        low=low,
        high=high,
        kendall=kendall,
        spearman=spearman,
        players=len(ranks[0]),
        fights=int(flown.sum()) * nominal.cause.shape[2],
    )


def rank_correlations(first: NDArray[Any], second: NDArray[Any]) -> tuple[float, float]:
    """Kendall's tau-b and Spearman's rho of two ratings [N]; NaN for fewer than `RANKED` players
    and where all are equal.
    """
    if len(first) < RANKED:
        return np.nan, np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", stats.ConstantInputWarning)
        tau: Any = stats.kendalltau(first, second)
        rho: Any = stats.spearmanr(first, second)
    return float(tau.statistic), float(rho.statistic)


def _by_start(result: TournamentResult, flown: NDArray[np.bool_], role: int) -> NDArray[Any]:
    """Mean score of the side by start [E], all cells alike."""
    points = fight_scores(result)[flown].mean(axis=0)
    return 1.0 - points if role else points


def _interval(losses: NDArray[Any]) -> tuple[float, float]:
    """95 % interval of the mean of independent losses [E]."""
    if len(losses) < 2:
        return np.nan, np.nan
    half = float(stats.t.ppf(0.975, len(losses) - 1)) * float(stats.sem(losses))
    mean = float(losses.mean())
    return mean - half, mean + half


def _ratings(result: TournamentResult, flown: NDArray[np.bool_], role: int) -> NDArray[Any]:
    """Bradley-Terry ratings of the players of `role` who flew, by the cells `flown`."""
    wins, ties, losses = (np.where(flown, number, 0) for number in scores(result))
    rating = bradley_terry(wins, losses, ties).rating
    side = rating[flown.shape[0] :] if role else rating[: flown.shape[0]]
    return side[np.atleast_1d(flown.any(axis=1 - role))]
