"""Order-free ratings: Bradley-Terry, and Davidson's model for ties, by Newton with standard
errors.

x = (defender's strength - attacker's strength). Bradley-Terry: P(win) = 1 / (1 + e^-x), a tie is
half a win and half a loss. Davidson (1970): win, tie and loss are as e^(x/2) : nu : e^(-x/2).
Players: defenders first, P = D + A.

Prior, so that an unbeaten player is finite: every strength is normal about the mean of its
component with a standard deviation of PRIOR_SD points (so is log nu about 0). With 500 fights a
player it moves a rating by a thousandth.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root_scalar
from scipy.special import expit, log_expit

from dronecombat_jax.analysis.design import BOUNDED, OPEN_ABOVE, OPEN_BELOW, Design, design_of
from dronecombat_jax.analysis.likelihood import bernoulli_cells, davidson_cells, differences, fit

POINTS = 400.0 / np.log(10.0)  # Elo points per unit of x (eq. 3)
START = 1500.0  # points, the gauge
PRIOR_SD = 800.0  # points
TAIL = 0.025  # of a 95 % interval
NORMAL_95 = 1.959963984540054


class Ratings(NamedTuple):
    """Ratings in Elo points.

    Gauge: the mean over each component's players, of both sides, is 1500.
    """

    rating: NDArray[np.float64]  # [P] defenders, then attackers
    error: NDArray[np.float64]  # [P] standard error in this gauge; inf for a player without fights
    low: NDArray[np.float64]  # [P] 95 % interval; -inf where nothing bounds the rating
    high: NDArray[np.float64]  # [P]
    covariance: NDArray[np.float64]  # [P, P] points^2
    design: Design  # flags by player: component, bound, games
    tie: float  # nu of Davidson's model; 0 where ties are halves
    log_likelihood: float  # of the data, the prior not included
    # Pearson chi^2 per degree of freedom: well above 1, the fights are not additive; NaN without
    # any
    dispersion: float


def bradley_terry(
    wins: NDArray[Any], losses: NDArray[Any], ties: NDArray[Any], prior_sd: float | None = PRIOR_SD
) -> Ratings:
    """Rate D defenders and A attackers by fights counted in three [D, A] from the defender's side;
    0 where not played.

    `prior_sd` in points; None: plain maximum likelihood, which raises ValueError where that is not
    finite.
    """
    design = design_of(wins, losses, ties)
    won, lost = wins + ties / 2, losses + ties / 2
    precision = prior_precision(design, prior_sd)
    theta, covariance, value = fit(
        lambda x, log_nu: bernoulli_cells(won, lost, x), precision, wins.shape
    )
    ratings = describe(theta, covariance, design, log_expit, won, lost)
    x = differences(theta, wins.shape)
    return ratings._replace(log_likelihood=value, dispersion=_dispersion(won, lost, x, design))


def davidson(
    wins: NDArray[Any], losses: NDArray[Any], ties: NDArray[Any], prior_sd: float | None = PRIOR_SD
) -> Ratings:
    """As `bradley_terry`, with ties as outcomes of their own (Davidson 1970)."""
    design = design_of(wins, losses, ties)
    if prior_sd is None and (not ties.any() or not (wins.any() or losses.any())):
        raise ValueError(
            "without ties, or with nothing else, nu has no finite maximum: give a prior"
        )
    prior = prior_precision(design, prior_sd)
    precision = np.zeros((len(prior) + 1,) * 2)
    precision[:-1, :-1] = prior
    precision[-1, -1] = 0.0 if prior_sd is None else (POINTS / prior_sd) ** 2
    cells = lambda x, log_nu: davidson_cells(wins, losses, ties, x, log_nu)
    theta, covariance, value = fit(cells, precision, wins.shape, with_ties=True)
    log_nu = theta[-1]
    log_win = lambda x: x / 2 - np.logaddexp(np.logaddexp(x / 2, -x / 2), log_nu)
    ratings = describe(
        theta[:-1], covariance[:-1, :-1], design, log_win, wins + ties / 2, losses + ties / 2
    )
    return ratings._replace(log_likelihood=value, tie=float(np.exp(log_nu)))


def prior_precision(design: Design, prior_sd: float | None) -> NDArray[np.float64]:
    """Inverse covariance [P, P] of the strengths; raises ValueError for none where the maximum is
    not finite.
    """
    total = len(design.bound)
    if prior_sd is not None:
        return np.eye(total) * (POINTS / prior_sd) ** 2
    if np.any(design.bound != BOUNDED):
        raise ValueError(
            f"{np.sum(design.bound != BOUNDED)} of {total} players have no finite maximum: give a prior"
        )
    same = design.component[:, None] == design.component[None, :]
    # holds each component's mean at 0, where the likelihood leaves it free
    return same / same.sum(axis=1)


def describe(
    theta: NDArray[Any],
    covariance: NDArray[Any],
    design: Design,
    log_win: Callable[..., Any],
    won: NDArray[Any],
    lost: NDArray[Any],
) -> Ratings:
    """Strengths [P] and their covariance as points in the gauge, with intervals; `log_win(x)` is
    the model's.
    """
    same = design.component[:, None] == design.component[None, :]
    centre = np.eye(len(theta)) - same / same.sum(axis=1)
    theta, covariance = centre @ theta, centre @ covariance @ centre.T * POINTS**2
    error = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    rating = START + POINTS * theta
    low, high = rating - NORMAL_95 * error, rating + NORMAL_95 * error
    size = won.shape
    for player in np.flatnonzero(design.bound != BOUNDED):
        side, index = (0, player) if player < size[0] else (1, player - size[0])
        opponents = theta[size[0] :] if side == 0 else theta[: size[0]]
        good, bad = (won[index], lost[index]) if side == 0 else (lost[:, index], won[:, index])
        if design.bound[player] == OPEN_ABOVE:
            high[player] = np.inf
            low[player] = _closed_end(opponents, good, log_win) if not bad.any() else low[player]
        elif design.bound[player] == OPEN_BELOW:
            low[player] = -np.inf
            high[player] = (
                _closed_end(-opponents, bad, log_win, -1) if not good.any() else high[player]
            )
        else:
            low[player], high[player] = -np.inf, np.inf
    error[design.games == 0] = np.inf
    return Ratings(rating, error, low, high, covariance, design, 0.0, np.nan, np.nan)


def contrast(ratings: Ratings, first: int, second: int) -> tuple[float, float]:
    """Rating of player `one` minus that of `other` and its standard error, points; NaN across
    components.
    """
    if ratings.design.component[first] != ratings.design.component[second]:
        return np.nan, np.nan
    sign = np.zeros(len(ratings.rating))
    sign[first] += 1.0
    sign[second] -= 1.0
    return float(sign @ ratings.rating), float(np.sqrt(max(sign @ ratings.covariance @ sign, 0.0)))


def _closed_end(
    opponents: NDArray[Any], games: NDArray[Any], log_win: Callable[..., Any], sign: int = 1
) -> float:
    """The rating, points, at which winning all `games` against `opponents` has the probability of
    one tail.
    """
    excess = lambda strength: float(games @ log_win(strength - opponents)) - np.log(TAIL)
    reach = 100.0 + np.abs(opponents).max()
    return (
        START + POINTS * sign * root_scalar(excess, bracket=(-reach, reach), method="brentq").root
    )


def _dispersion(won: NDArray[Any], lost: NDArray[Any], x: NDArray[Any], design: Design) -> float:
    games, rate = won + lost, expit(x)
    variance = np.maximum(games * rate * expit(-x), 1e-300)
    freedom = np.sum(games > 0) - len(design.bound) + len(np.unique(design.component))
    return float(np.sum((won - games * rate) ** 2 / variance) / freedom) if freedom > 0 else np.nan
