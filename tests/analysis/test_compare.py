"""Does one method's final defender beat another's?"""

import numpy as np
import pytest
from cross_plays import METHODS, NAN, cross_play, panel_of
from scipy import stats
from scipy.special import expit
from tournaments import build, entrants, from_rates

from dronecombat_jax.analysis.compare import (
    compare_methods,
    elo_of_score,
    equivalence,
    pigeonhole_interval,
    welch,
)
from dronecombat_jax.analysis.forgetting import at_home
from dronecombat_jax.analysis.panel import away_panel, fill_home, mean_scores
from dronecombat_jax.types import Cause


def equal_defenders(first, second, seeds=8, episodes=50):
    """Every defender wins the share `first` against the first method's attackers, else `second`."""
    share = np.repeat([first, second], seeds)[None, :, None]
    won = np.arange(episodes) < episodes * share - 1e-9
    cause = np.where(won, Cause.INTERCEPT, Cause.REACHED).astype(np.int8)
    sides = entrants("d", seeds, 1, METHODS), entrants("a", seeds, 1, METHODS)
    return build(np.broadcast_to(cause, (2 * seeds, 2 * seeds, episodes)), *sides)


def test_seven_of_eight_seeds_are_compared_and_the_eighth_is_reported():
    result = cross_play(2.0, seeds=4)
    gone = [index for index, one in enumerate(result.defenders) if one.lineage == "ippo#3"]
    cause = result.cause.copy()
    cause[gone] = Cause.NONE
    (told,) = compare_methods(build(cause, result.defenders, result.attackers))
    assert told.seeds == (3, 4)
    assert told.missing == ("ippo#3",)
    assert told.verdict == "s-ippo beats ippo"
    assert told.p_value == pytest.approx(1 / 35)


def test_a_planted_difference_is_found_with_its_size():
    (told,) = compare_methods(cross_play(0.8))
    assert (told.first, told.second) == METHODS
    assert told.adjusted_score.high < 0 and told.new_attackers[1] < 0
    assert told.p_value <= 0.01 and told.adjusted_p == told.p_value and told.exact
    assert told.adjusted_equivalence_p == told.equivalence_p
    assert told.elo.low < -0.8 * 173.7 < told.elo.high
    assert told.effect < -1.5
    assert told.equivalence_p > 0.5
    assert told.verdict == "s-ippo beats ippo"
    assert told.fights == 200 * 13  # 11 other runs' finals and 2 pilots


def test_equal_methods_are_called_equivalent_only_when_that_is_shown():
    (told,) = compare_methods(cross_play(0.0, seed=1, spread=0.01, episodes=400))
    assert told.verdict == "ippo and s-ippo are equivalent within 25 Elo"
    assert told.equivalence_p < 0.05 < told.p_value
    (told,) = compare_methods(cross_play(0.0, seed=1, spread=0.6))
    assert told.verdict == "undecided between ippo and s-ippo"


def test_several_methods_are_corrected_for_their_number():
    defenders, attackers = (
        entrants("d", 4, 1, ("a", "b", "c")),
        entrants("a", 4, 1, ("a", "b", "c")),
    )
    x = (
        np.repeat([0.0, 0.0, 3.0], 4)[:, None]
        + np.random.default_rng(0).normal(0, 0.1, (12, 1))
        + np.zeros(12)
    )
    told = compare_methods(from_rates(expit(x), 300, 0, defenders=defenders, attackers=attackers))
    assert [(one.first, one.second) for one in told] == [("a", "b"), ("a", "c"), ("b", "c")]
    assert told[1].p_value == pytest.approx(2 / 70)
    assert told[1].adjusted_p == pytest.approx(6 / 70)  # the least of three
    # 4 seeds a method cannot carry three pairs
    assert told[1].verdict == "undecided between a and c"
    with pytest.raises(ValueError, match="'nobody'"):
        compare_methods(cross_play(0.0), ["ippo", "nobody"])


def test_the_order_of_entrants_does_not_matter():
    result = cross_play(0.3)
    rng = np.random.default_rng(0)
    rows, columns = rng.permutation(len(result.defenders)), rng.permutation(len(result.attackers))
    other = build(
        result.cause[np.ix_(rows, columns)],
        [result.defenders[one] for one in rows],
        [result.attackers[one] for one in columns],
    )
    assert compare_methods(result) == compare_methods(other)


def test_welch_and_equivalence_agree_with_scipy():
    rng = np.random.default_rng(1)
    first, second = rng.normal(10, 20, 8), rng.normal(0, 45, 7)
    theirs = stats.ttest_ind(first, second, equal_var=False)
    interval = theirs.confidence_interval(0.95)
    ours = welch(first, second)
    assert (ours.low, ours.high) == pytest.approx((interval.low, interval.high))
    above = stats.ttest_ind(first + 25, second, equal_var=False, alternative="greater")[1]
    below = stats.ttest_ind(first - 25, second, equal_var=False, alternative="less")[1]
    assert equivalence(first, second, 25.0) == pytest.approx(max(above, below))


def test_one_seed_or_no_spread_gives_no_false_interval():
    assert np.isnan(welch(np.array([1.0]), np.array([0.0, 1.0])).low)
    assert np.isnan(equivalence(np.array([1.0]), np.array([1.0])))
    assert welch(np.ones(3), np.zeros(3))[:2] == (1.0, 0.0)
    assert equivalence(np.ones(3), np.zeros(3), 2.0) == 0
    assert equivalence(np.ones(3), np.zeros(3), 0.5) == 1
    (told,) = compare_methods(cross_play(0.5, seeds=1))
    assert told.p_value == 1
    assert np.isnan(told.adjusted_score.low) and np.isnan(told.new_attackers).all()
    assert told.verdict.startswith("undecided")


def test_unequal_attackers_bias_the_plain_mean_and_not_the_adjusted_one():
    # Additive and without noise: the second method's attackers give 0.2 more away. Each method has
    # 3 runs, so the first's defenders meet 2 strong and 3 weak (0.12 on average), the second's 3
    # and 2 (0.08).
    table = 0.5 + np.tile(np.repeat([0.0, 0.2], 3), (6, 1))
    np.fill_diagonal(table, NAN)
    plain = np.nanmean(table, axis=1)
    assert plain[:3].mean() - plain[3:].mean() == pytest.approx(0.2 / (2 * 3 - 1))
    filled = fill_home(table, np.ones(6))
    np.testing.assert_allclose(filled, 0.5 + np.tile(np.repeat([0.0, 0.2], 3), (6, 1)))
    assert mean_scores(filled, np.ones(6)).tolist() == [0.6] * 6  # no differences by rounding


def test_equal_defenders_are_equal_whatever_the_methods_attackers_are():
    """0.6 against one method's attackers, 0.3 against the other's: plain means 0.440 and 0.460."""
    result = equal_defenders(0.6, 0.3)
    (told,) = compare_methods(result)
    tilt = (7 * 0.6 + 8 * 0.3 - 8 * 0.6 - 7 * 0.3) / 15
    assert told.plain_score.difference == pytest.approx(tilt) and tilt == pytest.approx(-0.02)
    assert told.p_value == 1 and told.verdict == "ippo and s-ippo are equivalent within 25 Elo"
    assert told.adjusted_score.difference == told.elo.difference == 0
    assert told.new_attackers == pytest.approx((0, 0), abs=1e-12)
    # And what differs at home is the attackers' doing.
    panel = away_panel(result)
    own = at_home(result, panel)
    assert {fate.advantage for fate in own.values()} == {0.0}
    assert {fate.worst for fate in own.values()} == {0.45}


def test_who_knows_its_own_attackers_by_heart_has_the_advantage_at_home():
    """Scores are row + column; at home all have 0.2 more, and the second 0.3 less than that."""
    rows, columns = np.array([0.3, 0.35, 0.4, 0.45]), np.array([0.0, 0.1, 0.2, 0.3])
    win = rows[:, None] + columns + 0.2 * np.eye(4)
    win[1, 1] -= 0.3
    won = np.arange(100) < 100 * win[..., None] - 1e-9
    cause = np.where(won, Cause.INTERCEPT, Cause.REACHED).astype(np.int8)
    result = build(cause, entrants("d", 2, 1, METHODS), entrants("a", 2, 1, METHODS))
    own = at_home(result, away_panel(result))
    np.testing.assert_allclose([own[run].advantage for run in own], [0.2, -0.1, 0.2, 0.2])
    # At the panel's mean attacker, column 0.15: the row, and what is special at home.
    np.testing.assert_allclose([own[run].worst for run in own], rows + 0.15 + [0.2, -0.1, 0.2, 0.2])


def test_the_interval_for_new_attackers_covers_where_the_seeds_interval_does_not():
    # The methods differ only in whom they suit: against a new set of attackers the difference is 0
    # on average.
    rng = np.random.default_rng(2)
    methods = ["a"] * 6 + ["b"] * 6
    pigeonhole, seeds = [], []
    for seed in range(150):
        suits = np.where(np.arange(12) < 6, 1.0, -1.0)[:, None] * rng.normal(0, 0.1, 12)
        table = 0.5 + suits + rng.normal(0, 0.03, (12, 12)) + rng.normal(0, 0.03, (12, 1))
        np.fill_diagonal(table, NAN)
        panel = panel_of(table, methods)
        low, high = pigeonhole_interval(panel, "a", "b", 300, seed)
        pigeonhole.append(low < 0 < high)
        alone = welch(panel.adjusted[:6], panel.adjusted[6:])
        seeds.append(alone.low < 0 < alone.high)
    assert 0.9 <= np.mean(pigeonhole) <= 0.995
    assert np.mean(seeds) < 0.8


def test_elo_of_a_score_by_hand():
    # 10 wins in 11 are 10 to 1: 400 points. With half a fight added on both sides 9.5 in 10 become
    # 10 in 11.
    assert elo_of_score(np.array(0.95), np.array(10)) == pytest.approx(400.0)
    assert np.isfinite(elo_of_score(np.array([0.0, 1.0]), np.array([5, 5]))).all()
    # What a home cell adds may carry an adjusted score past its ends.
    ends = elo_of_score(np.array([-0.2, 0.0, 1.0, 1.2]), np.array([5, 5, 5, 5]))
    assert ends[0] == ends[1] and ends[2] == ends[3]
