"""Tests by relabelling: exact, honest at the level, as strong as promised."""

from math import comb

import numpy as np
import pytest
from scipy import stats

from dronecombat_jax.analysis.permutation import (
    holm,
    max_t_test,
    permutation_test,
    sign_flip_test,
    spread_test,
)


def test_three_against_two_listed_by_hand():
    # (1, 2, 6) against (3, 4): chosen sums of three of {1, 2, 3, 4, 6} (16 in all) are 6 to 13. The
    # difference is s / 3 - (16 - s) / 2 = 5 s / 6 - 8: for 9 it is -0.5, and smaller in size only
    # for 10 (0.33).
    test = permutation_test(np.array([1.0, 2.0, 6.0]), np.array([3.0, 4.0]))
    assert (test.relabellings, test.exact) == (10, True)
    assert test.difference == pytest.approx(-0.5)
    # Sums: 124 -> 7, 123 -> 6, 126 -> 9, 134 -> 8, 136 -> 10, 146 -> 11, 234 -> 9, 236 -> 11, 246
    # -> 12, 346 -> 13.
    assert test.p_value == pytest.approx(0.9)


def test_eight_against_eight_agrees_with_scipy():
    rng = np.random.default_rng(1)
    first, second = rng.normal(1, 1, 8), rng.normal(0, 1, 8)
    ours = permutation_test(first, second)
    theirs = stats.permutation_test(
        (first, second),
        lambda x, y, axis: x.mean(axis) - y.mean(axis),
        n_resamples=np.inf,
        vectorized=True,
    )
    assert ours.relabellings == comb(16, 8) == 12870
    assert ours.p_value == pytest.approx(theirs.pvalue)


def test_paired_seeds_agree_with_scipy():
    rng = np.random.default_rng(2)
    differences = rng.normal(0.7, 1, 9)
    theirs = stats.permutation_test(
        (differences,), np.mean, permutation_type="samples", n_resamples=np.inf
    )
    ours = sign_flip_test(differences)
    assert (ours.relabellings, ours.exact) == (512, True)
    assert ours.p_value == pytest.approx(theirs.pvalue)


def test_the_type_one_error_is_five_percent_and_the_power_is_the_promised():
    # Power with 8 seeds: 0.46 at d = 1, 0.80 at d = 1.5 (EVALUATION). 600 data sets: sd 0.009 at 5
    # %, 0.02 at a half.
    rng = np.random.default_rng(3)
    reject = lambda d: np.mean(
        permutation_test(rng.normal(d, 1, (8, 600)), rng.normal(0, 1, (8, 600))).p_value <= 0.05
    )
    assert 0.03 <= reject(0.0) <= 0.07
    assert reject(1.0) == pytest.approx(0.46, abs=0.06)
    assert reject(1.5) == pytest.approx(0.80, abs=0.05)


def test_too_many_relabellings_are_sampled_and_the_labels_themselves_count():
    rng = np.random.default_rng(4)
    test = permutation_test(rng.normal(9, 1, 12), rng.normal(0, 1, 12))
    assert (test.relabellings, test.exact) == (20_001, False)
    assert test.p_value == pytest.approx(1 / 20_001)
    flips = sign_flip_test(rng.normal(9, 1, 20))
    assert not flips.exact and flips.p_value == pytest.approx(1 / 20_001)


def test_equal_samples_and_single_seeds():
    assert permutation_test(np.ones(3), np.ones(3)).p_value == 1
    # two relabellings: no evidence is possible
    assert permutation_test(np.array([1.0]), np.array([0.0])).p_value == 1
    with pytest.raises(ValueError, match="seed"):
        permutation_test(np.array([]), np.ones(3))


def test_unknown_values_have_no_p_value():
    assert np.isnan(permutation_test(np.array([1.0, np.nan]), np.zeros(2)).p_value)
    assert np.isnan(sign_flip_test(np.array([1.0, np.nan])).p_value)
    both = np.array([[1.0, np.nan], [2.0, 0.0]])
    assert np.isnan(permutation_test(both, np.zeros((2, 2))).p_value).tolist() == [False, True]


def test_holm_worked_by_hand():
    # Sorted 0.01, 0.02, 0.03, 0.04 times 4, 3, 2, 1 is 0.04, 0.06, 0.06, 0.04; never falling: 0.04,
    # 0.06, 0.06, 0.06.
    np.testing.assert_allclose(
        holm([0.03, 0.01, np.nan, 0.04, 0.02]), [0.06, 0.04, np.nan, 0.06, 0.06]
    )
    assert holm([0.9, 0.8]).tolist() == [1, 1]


def test_max_t_finds_the_planted_cell_and_errs_once_in_twenty_maps():
    rng = np.random.default_rng(5)
    noise = lambda: rng.normal(0, 0.1, (5, 6, 6))
    first = noise()
    first[:, 2, 3] += 0.6
    adjusted = max_t_test(first, noise())
    assert np.unravel_index(np.nanargmin(adjusted), (6, 6)) == (2, 3)
    assert adjusted[2, 3] <= 0.05
    wrong = [max_t_test(noise(), noise()).min() <= 0.05 for _ in range(300)]
    assert 0.02 <= np.mean(wrong) <= 0.08  # 252 relabellings in pairs: the level is 12 / 252


def test_max_t_of_one_cell_is_the_plain_test_and_holes_stay_holes():
    rng = np.random.default_rng(6)
    first, second = rng.normal(0.8, 1, (6, 1)), rng.normal(0, 1, (6, 1))
    # Of one cell, t grows with the difference: the same ranks, so the same p.
    assert max_t_test(first, second)[0] == pytest.approx(permutation_test(first, second).p_value[0])
    holed = np.column_stack([first, first])
    holed[0, 1] = np.nan
    assert np.isnan(max_t_test(holed, np.column_stack([second, second]))).tolist() == [False, True]


def test_the_spread_test_sees_spread_and_not_level():
    steady, wild = np.linspace(-1, 1, 8), np.linspace(-9, 9, 8)
    assert spread_test(wild, steady).p_value < 0.01
    assert spread_test(wild, steady).difference > 0
    assert spread_test(steady + 100, steady).p_value == 1
    # one common median would see a spread of 100
    assert spread_test(steady + 100, steady[1:-1]).p_value > 0.2
