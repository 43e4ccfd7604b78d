"""A newcomer's rating: against a slow search, the joint fit, and the share of intervals that hold
the truth.
"""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import expit

from dronecombat_jax.analysis.bradley_terry import POINTS, bradley_terry
from dronecombat_jax.analysis.newcomer import rate_newcomer, spread


def strength(points: np.ndarray | float) -> np.ndarray:
    """400 points are odds of 10 to 1 (eq. 3)."""
    return (np.asarray(points) - 1500.0) * np.log(10.0) / 400.0


def fights(won: list[int], games: int) -> np.ndarray:
    """[N, E] points: of `games` against each opponent the first `won[i]` were won."""
    return (np.arange(games) < np.asarray(won)[:, None]).astype(float)


def test_it_is_the_maximum_on_a_fine_grid_and_the_interval_where_it_fell_by_1_92():
    points = fights([7, 2, 9], 10)[:, ::-1].copy()
    points[1] = points[1, ::-1]  # so that no start is better than the next
    points[1, 2] = 0.5
    won, lost = points.sum(axis=1), (1.0 - points).sum(axis=1)
    anchors = np.asarray([1450.0, 1800.0, 1200.0])
    grid = np.arange(1000.0, 2200.0, 0.01)
    chance = expit(strength(grid)[:, None] - strength(anchors))
    height = won @ np.log(chance).T + lost @ np.log1p(-chance).T - (grid - 1500.0) ** 2 / 800**2 / 2
    best = np.argmax(height)
    inside = grid[height >= height.max() - 3.8415 / 2 * spread(points, chance[best])]
    placing = rate_newcomer(points, anchors)
    assert placing.rating == pytest.approx(grid[best], abs=0.02)
    assert placing[1:] == pytest.approx((inside[0], inside[-1]), abs=0.02)


def test_fights_from_one_start_that_are_all_the_same_are_one_fight():
    """Ten opponents as good as it is: ten times the same fight widen the variance ten times."""
    same = np.repeat(np.asarray([[1.0, 0.0] * 20]), 10, axis=0)
    # a start's ten fights vary by 100 times 40/39 of 1/4, ten fights alone by 10 times 1/4
    assert spread(same, np.full(10, 0.5)) == pytest.approx(10 * 40 / 39)
    wide, one = (rate_newcomer(points, np.full(len(points), 1500.0)) for points in (same, same[:1]))
    assert wide.high - wide.low == pytest.approx(one.high - one.low, rel=0.05)
    # without luck in common the model's own variance stays
    assert spread(np.tile(np.eye(10), 4), np.full(10, 0.5)) == 1.0
    assert spread(same[:, :1], np.full(10, 0.5)) == 1.0


def test_a_player_of_a_tournament_gets_the_rating_that_it_has_there():
    rng = np.random.default_rng(0)
    points = rng.choice([0.0, 0.5, 1.0], p=[0.4, 0.2, 0.4], size=(6, 5, 20))
    points[2] = 1.0  # never beaten
    wins, ties, losses = (np.sum(points == value, axis=2) for value in (1.0, 0.5, 0.0))
    joint = bradley_terry(wins, losses, ties).rating
    for player in range(6):
        rated = rate_newcomer(points[player], joint[6:])
        assert rated.rating == pytest.approx(joint[player], abs=1e-6)
    for player in range(5):
        rated = rate_newcomer(1.0 - points[:, player], joint[:6])
        assert rated.rating == pytest.approx(joint[6 + player], abs=1e-6)


def test_who_was_never_beaten_is_bounded_from_below_alone_and_the_mirror():
    anchors, all_won = np.asarray([1400.0, 1700.0]), np.ones((2, 12))
    best, worst = rate_newcomer(all_won, anchors), rate_newcomer(0.0 * all_won, 3000.0 - anchors)
    assert best.high == np.inf and worst.low == -np.inf
    # at the end of the interval, winning all 24 has a chance of 2.5 %
    assert np.prod(expit(strength(best.low) - strength(anchors)) ** 12) == pytest.approx(0.025)
    assert best.low < best.rating < 4000.0
    mirrored = [3000.0 - best.rating, 3000.0 - best.low]
    assert [worst.rating, worst.high] == pytest.approx(mirrored)


def test_more_fights_of_the_same_share_narrow_the_interval_by_their_root():
    anchors = np.linspace(1200.0, 1800.0, 7)
    few = (np.random.default_rng(2).random((7, 40)) < 0.5).astype(float)
    many = np.tile(few, 16)
    width = lambda rated: rated.high - rated.low
    ratio = width(rate_newcomer(few, anchors)) / width(rate_newcomer(many, anchors))
    assert ratio == pytest.approx(4.0, rel=0.03)


def test_without_a_fight_there_is_no_rating():
    with pytest.raises(ValueError, match="at least one fight"):
        rate_newcomer(np.zeros((3, 0)), np.full(3, 1500.0))


ANCHORS = np.linspace(1000.0, 2000.0, 21)
TRIALS = 500
SLACK = 3 * (0.95 * 0.05 / TRIALS) ** 0.5  # three standard errors of a share of 0.95


def held(trial: Callable[[], np.ndarray], truth: float) -> float:
    """The share of intervals that hold `truth`; `trial()`: the points [N, E] of one trial."""
    rated = [rate_newcomer(trial(), ANCHORS) for _ in range(TRIALS)]
    return float(np.mean([each.low <= truth <= each.high for each in rated]))


@pytest.mark.parametrize("truth", [1150.0, 1500.0, 1900.0])
@pytest.mark.parametrize("tied", [0.0, 0.3])
def test_95_of_100_intervals_hold_the_truth(truth: float, tied: float):
    """Fights by the model, `tied` of them ties; those make a score vary less: never fewer."""
    rng = np.random.default_rng(1)
    chance = expit(strength(truth) - strength(ANCHORS))
    # a tie in place of a win and a loss alike, which leaves the mean score as it was
    ties = 2.0 * tied * np.minimum(chance, 1.0 - chance)
    above = np.stack([chance - ties / 2, chance + ties / 2])[..., None]
    trial = lambda: (rng.random((21, 30)) < above).mean(axis=0) if tied else _fight(rng, chance)
    share = held(trial, truth)
    assert share > 0.95 - SLACK
    assert tied or share < 0.99  # no wider than it has to be


def test_95_of_100_hold_the_truth_where_a_start_suits_it_or_not():
    """What a start is worth, 150 points up or down, counts against every opponent; mixed up, the
    same fights look like more than they are.
    """
    rng = np.random.default_rng(3)
    worth = strength(1500.0 + 150.0 * np.asarray([-1.0, 1.0]))
    chance = expit(worth[:, None] + strength(1500.0) - strength(ANCHORS))  # [2, N]
    # the rating that describes it best: the model's mean score is the true one
    grid = np.arange(1400.0, 1600.0, 0.01)
    modelled = expit(strength(grid)[:, None] - strength(ANCHORS)).sum(axis=1)
    truth = float(grid[np.argmin(np.abs(modelled - chance.mean(axis=0).sum()))])

    def trial() -> np.ndarray:
        starts = rng.integers(2, size=60)
        return (rng.random((21, 60)) < chance[starts].T).astype(float)

    mixed = lambda: rng.permuted(trial(), axis=1)
    assert held(trial, truth) > 0.95 - SLACK
    assert held(mixed, truth) < 0.85


def _fight(rng: np.random.Generator, chance: np.ndarray) -> np.ndarray:
    return (rng.random((len(chance), 30)) < chance[:, None]).astype(float)


def test_points_are_those_of_elo():
    """Even scores against 1500 are 1500; odds of 10 to 1 are 400 points, but for the prior."""
    assert rate_newcomer(fights([50], 100), np.asarray([1500.0])).rating == pytest.approx(1500.0)
    odds = rate_newcomer(fights([1000], 1100), np.asarray([1500.0])).rating
    assert odds == pytest.approx(1900.0, abs=2.0)
    assert pytest.approx(400.0 / np.log(10.0)) == POINTS
