"""The smoothed curve of ratings."""

import numpy as np
import pytest
from tournaments import bradley_terry_rates, build, entrants

from dronecombat_jax.analysis.bradley_terry import POINTS, bradley_terry
from dronecombat_jax.analysis.random_walk import (
    Timeline,
    random_walk_curve,
    timelines,
    walk_precision,
)
from dronecombat_jax.analysis.result import Alias

STEP = 0.06  # of the planted walks, log-odds
TIME = np.arange(40.0)
CHAINS = (Timeline(np.arange(40), TIME), Timeline(40 + np.arange(40), TIME))


def planted(seed):
    rng = np.random.default_rng(seed)
    walks = np.cumsum(rng.normal(0, STEP, (2, 40)), axis=1)
    fights = lambda games: rng.binomial(games, bradley_terry_rates(*walks))
    truth = 1500 + POINTS * (walks - walks.mean()).reshape(-1)
    return truth, fights


def test_a_fifth_of_the_fights_gives_a_better_curve_than_plain_bradley_terry_on_all():
    smooth, plain, inside, widths = [], [], [], []
    for seed in range(6):
        truth, fights = planted(seed)
        few, many = fights(2), fights(10)
        curve = random_walk_curve(few, 2 - few, 0 * few, CHAINS)
        rough = bradley_terry(many, 10 - many, 0 * many)
        smooth.append(np.mean((curve.ratings.rating - truth) ** 2))
        plain.append(np.mean((rough.rating - truth) ** 2))
        inside.append((curve.ratings.low < truth) & (truth < curve.ratings.high))
        widths.append(curve.width)
        assert not curve.at_limit
    assert np.mean(smooth) < np.mean(plain)
    assert 0.88 < np.mean(inside) < 0.99
    assert np.exp(np.mean(np.log(widths))) == pytest.approx(STEP * POINTS, rel=0.35)


def test_a_narrow_walk_is_a_constant_and_a_wide_one_is_plain_bradley_terry():
    _, fights = planted(1)
    wins = fights(50)
    tables = (wins, 50 - wins, 0 * wins)
    flat = random_walk_curve(*tables, CHAINS, width=1e-3).ratings.rating
    assert np.ptp(flat[:40]) < 0.01
    wide = random_walk_curve(*tables, CHAINS, width=1e5, prior_sd=1e5).ratings.rating
    np.testing.assert_allclose(wide, bradley_terry(*tables, prior_sd=None).rating, atol=0.1)


def test_the_prior_is_the_walks_of_the_formula():
    # (theta_1 - theta_0)^2 / (2 w^2 * 2) + (theta_2 - theta_1)^2 / (2 w^2), the first and the
    # fourth anchored by s.
    w, s = 0.5, 2.0
    theta = np.array([0.3, -0.2, 0.7, 1.1])
    formula = (
        ((-0.5) ** 2 / (2 * w**2 * 2)) + (0.9**2 / (2 * w**2)) + (0.3**2 + 1.1**2) / (2 * s**2)
    )
    precision = walk_precision(
        4, [Timeline(np.array([0, 1, 2]), np.array([0.0, 2, 3]))], w * POINTS, s * POINTS
    )
    assert theta @ precision @ theta / 2 == pytest.approx(formula)


def test_timelines_are_runs_in_order_of_training():
    defenders, attackers = entrants("d", 2, 3, scripted=1), entrants("a", 1, 2)
    result = build(np.ones((7, 2, 1), np.int8), defenders[::-1], attackers)
    chains = timelines(result)
    assert [chain.players.tolist() for chain in chains] == [[3, 2, 1], [6, 5, 4], [7, 8]]
    assert chains[0].time.tolist() == [1, 2, 3]


def test_time_stands_still_while_a_policy_is_saved_unchanged_and_a_shared_one_has_one_timeline():
    # The first stands at chunks 1, 2 and 3, the second is saved after 4, the third after 6: gaps of
    # 1 and 2.
    one, two, three = entrants("d", 1, 3)
    alias = lambda chunk, run="ippo": Alias("", "ippo", run, 0, chunk, 0)
    also = (alias(2), alias(3), alias(1, "copy"))
    defenders = [one._replace(also=also), two._replace(chunk=4), three._replace(chunk=6)]
    chains = timelines(build(np.ones((3, 1, 1), np.int8), defenders))
    assert [chain.players.tolist() for chain in chains] == [[0, 1, 2], [3]]
    assert np.diff(chains[0].time).tolist() == [1, 2]


@pytest.mark.parametrize(
    "chains",
    [
        [Timeline(np.array([0, 1]), np.array([1.0, 1.0]))],
        [Timeline(np.array([0, 1]), np.array([0.0, 1.0]))] * 2,
    ],
)
def test_impossible_timelines_are_refused(chains):
    with pytest.raises(ValueError, match="timeline"):
        walk_precision(2, chains, 10.0, 800.0)
