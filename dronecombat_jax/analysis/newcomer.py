"""One newcomer's rating against players whose ratings stand: Bradley-Terry in a single unknown.

What does not live here: rating everybody at once (`bradley_terry`), whose model, prior and gauge
these are. Against the players of its own tournament a player gets the rating that it has there.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root_scalar
from scipy.special import expit, log_expit

from dronecombat_jax.analysis.bradley_terry import POINTS, PRIOR_SD, START, TAIL

CHI2_95 = 3.841458820694124  # of one degree of freedom
_REACH = 60.0  # units of the log-odds: beyond it lies no maximum that the prior allows


class Placing(NamedTuple):
    """A newcomer's rating in Elo points, on the same scale as its opponents'."""

    rating: float
    low: float  # of the 95 % interval; -inf: it never scored, and nothing bounds it from below
    high: float  # inf: it was never beaten


def rate_newcomer(points: NDArray[Any], anchors: NDArray[Any]) -> Placing:
    """The most likely rating of a newcomer that scored `points` [N, E] against players rated
    `anchors` [N].

    A fight's points are 1, 1/2 or 0; fight e starts alike against all. The prior is that of
    `bradley_terry`. Interval: the ratings whose log-likelihood is within 1.92 of the best (Wilks
    1938), or within 1.92 times `spread` of it (Chandler and Bate 2007): fights from one start are
    alike, and their luck adds up. Where everything was won, the interval goes from the rating at
    which that has a chance of 2.5 % up to infinity; its mirror where nothing was. The anchors'
    ratings are taken as they stand. Raises ValueError without a fight.
    """
    points = np.asarray(points, float)
    if not points.size:
        raise ValueError("a rating needs at least one fight")
    won, lost = points.sum(axis=1), (1.0 - points).sum(axis=1)
    strengths = (np.asarray(anchors, float) - START) / POINTS
    reach = _REACH + np.abs(strengths).max()
    best = _root(lambda theta: _slope(theta, won, lost, strengths), -reach, reach)
    if not lost.any():
        low, high = _all_won(won, strengths), np.inf
    elif not won.any():
        low, high = -np.inf, -_all_won(lost, -strengths)
    else:
        fall = CHI2_95 / 2 * spread(points, expit(best - strengths))
        top = _value(best, won, lost, strengths) - fall
        excess = lambda theta: _value(theta, won, lost, strengths) - top
        reach += 10.0 * fall
        low, high = _root(excess, -reach, best), _root(excess, best, reach)
    return Placing(*(START + POINTS * theta for theta in (best, low, high)))


def spread(points: NDArray[Any], chance: NDArray[Any]) -> float:
    """How much more scores vary between starts than independent fights would; at least 1.

    `points` [N, E] of the fights, `chance` [N] of a win by the model. Starts are independent; the
    fights from one start need not be.
    """
    if points.shape[1] < 2:
        return 1.0
    alone = float(np.sum(chance * (1.0 - chance)))
    return max(1.0, float(np.var(points.sum(axis=0), ddof=1)) / alone)


def _value(theta: float, won: NDArray[Any], lost: NDArray[Any], strengths: NDArray[Any]) -> float:
    """Log-likelihood and prior."""
    x = theta - strengths
    return float(won @ log_expit(x) + lost @ log_expit(-x)) - (theta * POINTS / PRIOR_SD) ** 2 / 2


def _slope(theta: float, won: NDArray[Any], lost: NDArray[Any], strengths: NDArray[Any]) -> float:
    """The derivative of `_value`, which falls."""
    expected = (won + lost) @ expit(theta - strengths)
    return float(won.sum() - expected) - theta * (POINTS / PRIOR_SD) ** 2


def _all_won(games: NDArray[Any], strengths: NDArray[Any]) -> float:
    """The strength at which winning all `games` has the probability of one tail."""
    reach = 100.0 + np.abs(strengths).max()
    excess = lambda theta: float(games @ log_expit(theta - strengths)) - np.log(TAIL)
    return _root(excess, -reach, reach)


def _root(function: Any, low: float, high: float) -> float:
    return float(root_scalar(function, bracket=(low, high), method="brentq", xtol=1e-12).root)
