"""Sequential Elo as printed (eq. 3, 4), and over random orders."""

import evalica
import numpy as np
import pytest
from tournaments import bradley_terry_rates, build, from_letters, from_rates

from dronecombat_jax.analysis.bradley_terry import bradley_terry
from dronecombat_jax.analysis.elo import elo_ratings, play_in_order
from dronecombat_jax.analysis.result import scores

PLANTED = from_rates(
    bradley_terry_rates(np.linspace(-0.6, 0.6, 10), np.linspace(-0.3, 0.9, 10)), 200, seed=1
)


def test_three_fights_worked_by_hand():
    # D0 beats A0:   E = 1 / (1 + 10^0) = 0.5;               D0 1500 + 32 (1 - 0.5) = 1516, A0 1484.
    # D1 ties with A0:   E_D1 = 1 / (1 + 10^((1484 - 1500) / 400)) = 1 / (1 + 0.912011) = 0.523010
    #                D1 1500 + 32 (0.5 - 0.523010) = 1499.26368, A0 1484.73632.
    # D0 loses A0:   E_D0 = 1 / (1 + 10^((1484.73632 - 1516) / 400)) = 1 / (1 + 0.835298) = 0.544870
    #                D0 1516 - 32 * 0.544870 = 1498.56416, A0 1502.17216.
    defender, attacker = play_in_order(
        np.array([0, 1, 0]), np.array([0, 0, 0]), np.array([1.0, 0.5, 0.0]), (2, 1)
    )
    np.testing.assert_allclose(defender, [1498.56416, 1499.26368], atol=5e-5)
    np.testing.assert_allclose(attacker, [1502.17216], atol=5e-5)


def test_a_sequence_of_fights_agrees_with_evalica():
    rng = np.random.default_rng(3)
    defender, attacker, doubled = (
        rng.integers(0, 4, 300),
        rng.integers(0, 3, 300),
        rng.integers(0, 3, 300),
    )
    winner = [(evalica.Winner.Y, evalica.Winner.Draw, evalica.Winner.X)[one] for one in doubled]
    theirs = evalica.elo(
        [f"d{one}" for one in defender],
        [f"a{one}" for one in attacker],
        winner,
        initial=1500.0,
        k=32.0,
    )
    ours = play_in_order(defender, attacker, doubled / 2, (4, 3))
    for index, rating in enumerate(ours[0]):
        assert rating == pytest.approx(theirs.scores[f"d{index}"], abs=1e-9)
    for index, rating in enumerate(ours[1]):
        assert rating == pytest.approx(theirs.scores[f"a{index}"], abs=1e-9)


def test_the_sum_of_all_ratings_is_conserved():
    ratings = elo_ratings(PLANTED, orders=2)
    assert ratings.defender.sum() + ratings.attacker.sum() == pytest.approx(20 * 1500, abs=1e-7)


def test_the_mean_over_orders_comes_near_the_maximum_of_the_likelihood_and_the_spread_is_elos():
    ratings = elo_ratings(PLANTED, orders=400)
    exact = bradley_terry(
        *(getattr(scores(PLANTED), name) for name in ("wins", "losses", "ties")), prior_sd=None
    )
    # The mean of 400 orders has an error of 52.6 / 20 points; K = 32 itself biases by a point or
    # two.
    np.testing.assert_allclose(
        np.concatenate([ratings.defender, ratings.attacker]), exact.rating, atol=10
    )
    spread = np.mean([*ratings.defender_spread, *ratings.attacker_spread])
    assert spread == pytest.approx(9.3 * np.sqrt(32), rel=0.2)


def test_the_order_of_entrants_does_not_matter_to_the_last_bit():
    rng = np.random.default_rng(0)
    rows, columns = rng.permutation(10), rng.permutation(10)
    shuffled = build(
        PLANTED.cause[np.ix_(rows, columns)],
        [PLANTED.defenders[one] for one in rows],
        [PLANTED.attackers[one] for one in columns],
    )
    straight, other = elo_ratings(PLANTED, orders=3), elo_ratings(shuffled, orders=3)
    assert other.defender.tolist() == straight.defender[rows].tolist()
    assert other.attacker.tolist() == straight.attacker[columns].tolist()
    assert elo_ratings(PLANTED, orders=3, seed=1).defender.tolist() != straight.defender.tolist()


def test_only_played_fights_count():
    ratings = elo_ratings(from_letters([["ww", "..", ".."], ["..", "..", "dd"]]), orders=2)
    # Two wins in any order: 1516, then E = 1 / (1 + 10^(-32 / 400)) = 0.545922 and 1516 + 32 *
    # 0.454078 = 1530.53.
    np.testing.assert_allclose(ratings.defender, [1530.5305, 1500], atol=1e-3)
    np.testing.assert_allclose(ratings.attacker, [1469.4695, 1500, 1500], atol=1e-3)
    assert ratings.defender_games.tolist() == [2, 2]
    assert ratings.attacker_games.tolist() == [2, 0, 2]
    assert ratings.defender_spread.tolist() == [0, 0]
