"""A newcomer's rating: against a slow search, the joint fit, and the share of intervals that hold
the truth.
"""

import numpy as np
import pytest
from scipy.special import expit

from dronecombat_jax.analysis.bradley_terry import POINTS, bradley_terry
from dronecombat_jax.analysis.newcomer import rate_newcomer


def strength(points: np.ndarray | float) -> np.ndarray:
    """400 points are odds of 10 to 1 (eq. 3)."""
    return (np.asarray(points) - 1500.0) * np.log(10.0) / 400.0


def test_it_is_the_maximum_on_a_fine_grid_and_the_interval_where_it_fell_by_1_92():
    won, lost = np.asarray([7.0, 2.5, 9.0]), np.asarray([3.0, 7.5, 1.0])
    anchors = np.asarray([1450.0, 1800.0, 1200.0])
    grid = np.arange(1000.0, 2200.0, 0.01)
    chance = expit(strength(grid)[:, None] - strength(anchors))
    height = won @ np.log(chance).T + lost @ np.log1p(-chance).T - (grid - 1500.0) ** 2 / 800**2 / 2
    inside = grid[height >= height.max() - 3.8415 / 2]
    placing = rate_newcomer(won, lost, anchors)
    assert placing.rating == pytest.approx(grid[np.argmax(height)], abs=0.02)
    assert placing[1:] == pytest.approx((inside[0], inside[-1]), abs=0.02)


def test_a_player_of_a_tournament_gets_the_rating_that_it_has_there():
    rng = np.random.default_rng(0)
    fights = rng.multinomial(20, (0.4, 0.2, 0.4), size=(6, 5))
    wins, draws, losses = np.moveaxis(fights, -1, 0)
    wins[2], draws[2], losses[2] = 20, 0, 0  # never beaten
    joint = bradley_terry(wins, losses, draws).rating
    for player in range(6):
        won, lost = wins[player] + draws[player] / 2, losses[player] + draws[player] / 2
        assert rate_newcomer(won, lost, joint[6:]).rating == pytest.approx(joint[player], abs=1e-6)
    for player in range(5):
        won, lost = (one[:, player] + draws[:, player] / 2 for one in (losses, wins))
        assert rate_newcomer(won, lost, joint[:6]).rating == pytest.approx(
            joint[6 + player], abs=1e-6
        )


def test_who_was_never_beaten_is_bounded_from_below_alone_and_the_mirror():
    anchors, games = np.asarray([1400.0, 1700.0]), np.asarray([12.0, 12.0])
    none = np.zeros(2)
    best, worst = rate_newcomer(games, none, anchors), rate_newcomer(none, games, 3000.0 - anchors)
    assert best.high == np.inf and worst.low == -np.inf
    # at the end of the interval, winning all 24 has a chance of 2.5 %
    assert np.prod(expit(strength(best.low) - strength(anchors)) ** 12) == pytest.approx(0.025)
    assert best.low < best.rating < 4000.0
    mirrored = [3000.0 - best.rating, 3000.0 - best.low]
    assert [worst.rating, worst.high] == pytest.approx(mirrored)


def test_more_fights_of_the_same_share_narrow_the_interval_by_their_root():
    anchors = np.linspace(1200.0, 1800.0, 7)
    won = 20.0 * expit(strength(1550.0) - strength(anchors))
    few, many = (rate_newcomer(n * won, n * (20.0 - won), anchors) for n in (1, 16))
    assert (few.high - few.low) / (many.high - many.low) == pytest.approx(4.0, rel=0.02)


def test_without_a_fight_there_is_no_rating():
    with pytest.raises(ValueError, match="at least one fight"):
        rate_newcomer(np.zeros(3), np.zeros(3), np.full(3, 1500.0))


@pytest.mark.parametrize("truth", [1150.0, 1500.0, 1900.0])
@pytest.mark.parametrize("drawn", [0.0, 0.3])
def test_95_of_100_intervals_hold_the_truth(truth: float, drawn: float):
    """Fights drawn from the model, `drawn` of them draws; those make a score vary less: never fewer."""
    rng = np.random.default_rng(1)
    anchors = np.linspace(1000.0, 2000.0, 21)
    chance = expit(strength(truth) - strength(anchors))
    # a draw in place of a win and a loss alike, which leaves the mean score as it was
    draw = 2.0 * drawn * np.minimum(chance, 1.0 - chance)
    shares = np.stack([chance - draw / 2, draw, 1.0 - chance - draw / 2], axis=1)
    held, trials = 0, 600
    for _ in range(trials):
        wins, draws, losses = rng.multinomial(10, shares).T
        placing = rate_newcomer(wins + draws / 2, losses + draws / 2, anchors)
        held += placing.low <= truth <= placing.high
    # three standard errors of a share of 600 trials are 0.027
    assert held / trials > 0.95 - 0.027
    assert drawn or held / trials < 0.95 + 0.027


def test_points_are_those_of_elo():
    """Even scores against 1500 are 1500; odds of 10 to 1 are 400 points, but for the prior."""
    assert rate_newcomer([50.0], [50.0], [1500.0]).rating == pytest.approx(1500.0)
    assert rate_newcomer([1000.0], [100.0], [1500.0]).rating == pytest.approx(1900.0, abs=2.0)
    assert pytest.approx(400.0 / np.log(10.0)) == POINTS
