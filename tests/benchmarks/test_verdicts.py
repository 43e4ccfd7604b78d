"""The verdict keeps its level in all kinds of situation; the plain mean does not."""

import numpy as np
import pytest

from benchmarks.verdicts import (
    MORE,
    SITUATIONS,
    Situation,
    by_method,
    chances,
    simulate,
    tournament,
)
from dronecombat_jax.analysis.compare import compare_methods, welch
from dronecombat_jax.analysis.panel import away_panel, fill_home, mean_scores
from dronecombat_jax.analysis.permutation import permutation_test

COMPARISONS, SEEDS, FIGHTS = 800, 8, 50  # a share of 0.05 of 800 has a standard deviation of 0.008
NAMES = [one.name for one in SITUATIONS]
ALL = (*SITUATIONS, *MORE)


def scores(situation: Situation, comparisons: int) -> tuple[np.ndarray, np.ndarray]:
    """Adjusted and plain scores [R, comparisons], by the functions that `away_panel` calls."""
    rng = np.random.default_rng(1)
    adjusted, plain, weights = [], [], np.ones(2 * SEEDS)
    for _ in range(comparisons):
        table = rng.binomial(FIGHTS, chances(situation, SEEDS, rng)) / FIGHTS
        np.fill_diagonal(table, np.nan)
        adjusted.append(mean_scores(fill_home(table, weights), weights))
        plain.append(np.nanmean(table, axis=1))
    return np.transpose(adjusted), np.transpose(plain)


@pytest.mark.parametrize("situation", SITUATIONS, ids=NAMES)
def test_the_adjusted_score_errs_as_often_as_its_level_says(situation: Situation):
    adjusted, plain = scores(situation, COMPARISONS)
    errs = lambda values: np.mean(permutation_test(values[:SEEDS], values[SEEDS:]).p_value < 0.05)
    assert 0.03 <= errs(adjusted) <= 0.07
    if situation.name == "steady seeds, attackers unequal":
        assert errs(plain) > 0.3
    intervals = [welch(one[:SEEDS], one[SEEDS:]) for one in adjusted.T]
    assert 0.93 <= np.mean([one.low <= 0 <= one.high for one in intervals]) <= 0.97


def test_the_simulated_tournament_is_judged_by_the_same_numbers():
    rng = np.random.default_rng(2)
    chance = chances(SITUATIONS[3], 3, rng)
    result = tournament(chance, 3, FIGHTS, rng)
    panel = away_panel(result)
    table = (result.cause == 1).mean(axis=2)
    np.fill_diagonal(table, np.nan)
    ones = np.ones(6)
    np.testing.assert_allclose(panel.adjusted, mean_scores(fill_home(table, ones), ones))
    (told,) = compare_methods(result)
    assert told.p_value == permutation_test(*by_method(panel, panel.adjusted)).p_value


def test_what_is_planted_is_what_the_situation_says():
    still = Situation("", 0.0, 0.3, fewer=1)
    chance = chances(still, 3, np.random.default_rng(0))
    np.testing.assert_allclose(chance, np.tile([0.6, 0.6, 0.6, 0.3, 0.3], (5, 1)))
    # 25 points apart: the logits of 0.45 -+ 12.5 / 173.7.
    apart = chances(still._replace(attacker_gap=0.0), 3, np.random.default_rng(0), 25.0)[:, 0]
    logit = np.log(apart / (1 - apart)) * 400 / np.log(10)
    assert logit[3] - logit[0] == pytest.approx(25.0)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(ALL)), ids=[one.name for one in ALL])
def test_the_whole_verdict_keeps_its_promises(number: int):
    """`python -m benchmarks.verdicts` prints these numbers."""
    rates = simulate(ALL[number], 400, SEEDS, FIGHTS, np.random.default_rng([0, number]))
    assert 0.03 <= rates.yes <= 0.07
    assert 0.93 <= rates.welch <= 0.97
    assert rates.new_attackers >= 0.93
    assert rates.equivalent <= 0.07
