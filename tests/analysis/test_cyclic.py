"""The cyclic share: found where planted, and only there."""

import numpy as np
import pytest
from tournaments import bradley_terry_rates

from dronecombat_jax.analysis.cyclic import cyclic_share, split_logits

RNG_SEED = 7


def share(rate, games, seed, bootstrap=200):
    wins = np.random.default_rng(seed).binomial(games, rate)
    return cyclic_share(wins, games - wins, 0 * wins, bootstrap, seed)


def additive(size, spread, seed):
    rng = np.random.default_rng(seed)
    return rng.normal(0, spread, size)[:, None] - rng.normal(0, spread, size)


def discs(size, seed):
    """A planted rank-2 cycle: points on two circles."""
    one, other = np.random.default_rng(seed).uniform(0, 2 * np.pi, (2, size))
    return np.cos(one[:, None] - other)


def test_logits_split_as_a_table_worked_by_hand():
    # Mean 2; rows deviate by -1, 1 and columns by -0.5, 0.5; what is left is 0.5 (1, -1; -1, 1).
    rows, cyclic = split_logits(np.array([[1.0, 1.0], [2.0, 4.0]]))
    assert rows.tolist() == [[-1.5, -0.5], [0.5, 1.5]]
    assert cyclic.tolist() == [[0.5, -0.5], [-0.5, 0.5]]


def test_a_planted_cycle_is_found_with_its_size_and_its_two_dimensions():
    x = 0.5 * additive(20, 1.0, 1) + discs(20, 2)
    parts = [np.sum(part**2) for part in split_logits(x)]
    truth = parts[1] / sum(parts)
    found = share(1 / (1 + np.exp(-x)), 50, 3)
    assert found.p_value < 0.01
    assert found.corrected == pytest.approx(truth, abs=0.07)
    assert found.raw > found.corrected
    assert found.disc_share > 0.8  # the rest is the fights' noise
    rebuilt = found.defender_disc @ found.attacker_disc.T
    assert np.corrcoef(rebuilt.reshape(-1), split_logits(x)[1].reshape(-1))[0, 1] > 0.95


@pytest.mark.parametrize(("games", "expected"), [(5, 0.52), (20, 0.20), (100, 0.055)])
def test_the_raw_share_at_additive_truth_is_the_noise_that_the_correction_takes_off(
    games, expected
):
    # EVALUATION's figures hold for one spread of strengths, sd 0.75 in log-odds (at 0.5: 0.65,
    # 0.33, 0.09).
    x = additive(60, 0.75, 4)
    found = share(1 / (1 + np.exp(-x)), games, 5, bootstrap=60)
    assert found.raw == pytest.approx(expected, rel=0.25)
    assert found.null_mean == pytest.approx(found.raw, rel=0.08)
    assert found.corrected < 0.03


@pytest.mark.long
def test_at_additive_truth_it_is_found_one_time_in_twenty():
    rng = np.random.default_rng(RNG_SEED)
    found = []
    for seed in range(400):
        rate = bradley_terry_rates(rng.normal(0, 0.7, 7), rng.normal(0, 0.7, 7))
        # every other table has ties
        tied = rng.binomial(20, (seed % 2) * 1.6 * rate * (1 - rate))
        wins = rng.binomial(20 - tied, rate)
        found.append(cyclic_share(wins, 20 - tied - wins, tied, 59, seed).p_value <= 0.05)
    assert 0.03 <= np.mean(found) <= 0.07


def test_rows_and_columns_in_another_order_have_the_same_share():
    x = additive(8, 1.0, 1) + discs(8, 2)
    wins = np.random.default_rng(0).binomial(30, 1 / (1 + np.exp(-x)))
    order = np.random.default_rng(1).permutation(8)
    one = cyclic_share(wins, 30 - wins, 0 * wins, 20)
    other = cyclic_share(wins[order], 30 - wins[order], 0 * wins, 20)
    assert other.raw == pytest.approx(one.raw, abs=1e-12)
    np.testing.assert_allclose(abs(other.defender_disc), abs(one.defender_disc[order]), atol=1e-9)


def test_small_and_empty_tables():
    one = cyclic_share(np.array([[3]]), np.array([[1]]), np.array([[0]]), 20)
    assert np.isnan(one.raw) and one.corrected == 0 and one.p_value == 1
    assert one.defender_disc.shape == (1, 2)
    tied = cyclic_share(np.zeros((2, 2)), np.zeros((2, 2)), np.full((2, 2), 5), 20)
    assert np.isnan(tied.raw) and tied.p_value == 1
    with pytest.raises(ValueError, match="every cell"):
        cyclic_share(np.array([[3, 0]]), np.array([[1, 0]]), np.array([[0, 0]]))
