"""The curve of ratings over a run's training: Bradley-Terry with a random-walk prior along each
timeline.

Neighbours on a timeline share their fights: where a single rating's error exceeds a step of the
walk, a fifth of the fights gives a better curve than plain Bradley-Terry on all. It is for curves
only: the prior pulls the end of a timeline to its neighbours, so the test of final policies does
not use it.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import log_expit

from dronecombat_jax.analysis.bradley_terry import POINTS, PRIOR_SD, Ratings, describe
from dronecombat_jax.analysis.design import design_of
from dronecombat_jax.analysis.likelihood import bernoulli_cells, fit
from dronecombat_jax.analysis.result import TournamentResult, by_training

NARROWEST, WIDEST = 0.5, 500.0  # points per step of the timeline: where w is looked for


class Curve(NamedTuple):
    """Smoothed ratings; intervals are the posterior's, given w."""

    ratings: Ratings
    width: float  # w, points: standard deviation of a step between neighbours one chunk apart
    # w was not found inside (NARROWEST, WIDEST): the curve is all but constant, or not smoothed at
    # all
    at_limit: bool
    log_evidence: float  # of w, by Laplace's approximation


class Timeline(NamedTuple):
    """Players of one training and role, in the order of training."""

    players: NDArray[np.integer]  # [T] numbers in P
    # [T] chunks, strictly increasing; those that changed nothing are not counted
    time: NDArray[np.float64]


def timelines(result: TournamentResult) -> tuple[Timeline, ...]:
    """The timelines of all runs in a tournament, both roles; scripted pilots are in none.

    A timeline counts a policy once, however many chunks saved it unchanged. So one step of the walk
    is what one chunk has learnt. A policy that two runs share is on the timeline of the first.
    """
    chains, taken = [], set()
    for first, side in ((0, result.defenders), (len(result.defenders), result.attackers)):
        for saved in by_training(side).values():
            players: list[int] = []
            times: list[int] = []
            clock = before = saved[0][1].chunk
            for index, entrant in saved:
                clock += 0 if players and players[-1] == first + index else entrant.chunk - before
                before = entrant.chunk
                if first + index not in taken:
                    taken.add(first + index)
                    players.append(first + index)
                    times.append(clock)
            if players:
                chains.append(Timeline(np.asarray(players), np.asarray(times, float)))
    return tuple(chains)


def random_walk_curve(
    wins: NDArray[Any],
    losses: NDArray[Any],
    ties: NDArray[Any],
    chains: Sequence[Timeline],
    width: float | None = None,
    prior_sd: float = PRIOR_SD,
) -> Curve:
    """Ratings by fights [D, A] counted from the defender's side; a tie is half a win and half a
    loss.

    Prior: sum over neighbours of (theta_t - theta_t-1)^2 / (2 w^2 (time_t - time_t-1)); the first
    of each timeline, and every player in none, is normal with `prior_sd` points. `width` is w in
    points; None: the w of the largest marginal likelihood, p(data | w) ~ likelihood x prior x
    sqrt(|Q| / |H + Q|) at the mode (Laplace).
    """
    won, lost = wins + ties / 2, losses + ties / 2
    design = design_of(wins, losses, ties)
    total = len(design.bound)

    def solve(width: float) -> tuple[NDArray[Any], NDArray[Any], float]:
        precision = walk_precision(total, chains, width, prior_sd)
        theta, covariance, value = fit(
            lambda x, _: bernoulli_cells(won, lost, x), precision, won.shape
        )
        log_det = np.linalg.slogdet(precision)[1] + np.linalg.slogdet(covariance)[1]
        return theta, covariance, float(value - theta @ precision @ theta / 2 + log_det / 2)

    at_limit = False
    if width is None:
        limits = (np.log(NARROWEST), np.log(WIDEST))
        best = minimize_scalar(
            lambda log_width: -solve(float(np.exp(log_width)))[2],
            bounds=limits,
            method="bounded",
            options={"xatol": 0.02},
        )
        at_limit = bool(min(best.x - limits[0], limits[1] - best.x) < 0.05)
        width = float(np.exp(best.x))
    theta, covariance, log_evidence = solve(width)
    ratings = describe(theta, covariance, design, log_expit, won, lost)
    return Curve(ratings, width, at_limit, log_evidence)


def walk_precision(
    total: int, chains: Sequence[Timeline], width: float, prior_sd: float
) -> NDArray[np.float64]:
    """Q [P, P] of the prior, in units of x; raises ValueError for a timeline whose times do not
    increase, or that shares a player.
    """
    precision = np.zeros((total, total))
    anchored = np.ones(total, bool)
    seen = np.zeros(total, int)
    for players, time in chains:
        gaps = np.diff(time)
        if np.any(gaps <= 0):
            raise ValueError("a timeline's times must increase")
        weight = (POINTS / width) ** 2 / gaps
        first, second = players[:-1], players[1:]
        precision[first, first] += weight
        precision[second, second] += weight
        precision[first, second] -= weight
        precision[second, first] -= weight
        anchored[second] = False
        seen[players] += 1
    if np.any(seen > 1):
        raise ValueError("a player is on two timelines")
    precision[anchored, anchored] += (POINTS / prior_sd) ** 2
    return precision
