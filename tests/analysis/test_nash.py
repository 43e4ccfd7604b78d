"""The tournament as a matrix game."""

import nashpy
import numpy as np
import pytest
from scipy.optimize import linprog, minimize
from scipy.special import expit, logsumexp
from tournaments import build, entrants, from_letters

from dronecombat_jax.analysis.nash import SLACK, nash_average, population_values, solve
from dronecombat_jax.types import Cause

ROCK_PAPER_SCISSORS = np.array([[0.5, 0.0, 1.0], [1.0, 0.5, 0.0], [0.0, 1.0, 0.5]])
RANDOM = np.random.default_rng(0).random((6, 5))


def test_rock_paper_scissors_is_even():
    average = nash_average(ROCK_PAPER_SCISSORS)
    assert average.game.value == pytest.approx(0.5)  # 0 in wins minus losses
    np.testing.assert_allclose(average.game.defender_mix, 1 / 3)
    np.testing.assert_allclose(average.defender, 0.5)
    np.testing.assert_allclose(average.attacker, 0.5)


def test_a_two_by_two_game_worked_by_hand():
    # x = (p, 1 - p): 0.8 p + 0.3 (1 - p) = 0.2 p + 0.6 (1 - p) at p = 1/3, value 0.4667; y likewise
    # (4/9, 5/9).
    game = solve(np.array([[0.8, 0.2], [0.3, 0.6]]))
    assert game.value == pytest.approx(7 / 15)
    np.testing.assert_allclose(game.defender_mix, [1 / 3, 2 / 3])
    np.testing.assert_allclose(game.attacker_mix, [4 / 9, 5 / 9])
    assert game.gap == pytest.approx(0, abs=1e-12)


def test_value_and_mixtures_agree_with_nashpy():
    x, y = next(nashpy.Game(RANDOM).support_enumeration())
    game = solve(RANDOM)
    assert game.value == pytest.approx(x @ RANDOM @ y, abs=1e-10)
    np.testing.assert_allclose(game.defender_mix, x, atol=1e-9)
    np.testing.assert_allclose(game.attacker_mix, y, atol=1e-9)


def test_regret_matching_ends_at_the_same_value():
    # Regret matching+ (Tammelin 2014), a slow loop that has nothing in common with a linear
    # program.
    regrets, total = [np.zeros(6), np.zeros(5)], [np.zeros(6), np.zeros(5)]
    for turn in range(1, 4000):
        x, y = (r / r.sum() if r.sum() > 0 else np.full(len(r), 1 / len(r)) for r in regrets)
        total = [total[0] + turn * x, total[1] + turn * y]
        payoff = (RANDOM @ y, -(x @ RANDOM))
        mixes = (x, y)
        regrets = [
            np.maximum(r + p - m @ p, 0) for r, p, m in zip(regrets, payoff, mixes, strict=True)
        ]
    x, y = (sums / sums.sum() for sums in total)
    assert (x @ RANDOM).min() - 1e-3 < solve(RANDOM).value < (RANDOM @ y).max() + 1e-3
    assert (RANDOM @ y).max() - (x @ RANDOM).min() < 2e-3


def test_the_average_is_the_most_mixed_equilibrium():
    # Attacker 2 is no better than attackers 0 and 1 half each, so many mixtures are optimal; by
    # symmetry the most mixed one gives each the same: p in (p, p, 1 - 2 p), and the entropy is
    # largest at p = 1/3.
    scores = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5]])
    average = nash_average(scores)
    np.testing.assert_allclose(average.game.attacker_mix, 1 / 3, atol=1e-3)
    vertex = linprog(
        [0, 0, 0, 1],
        A_ub=[[1, 0, 0.5, -1], [0, 1, 0.5, -1]],
        b_ub=[0, 0],
        A_eq=[[1, 1, 1, 0]],
        b_eq=[1],
    )
    assert average.game.value == pytest.approx(vertex.fun)
    assert average.game.gap < 3e-5


def test_the_most_mixed_of_a_hundred_agrees_with_the_dual_problem():
    """Of largest entropy with M y <= limit: y ~ exp(-M' price), the prices >= 0 minimise log sum
    exp(-M' price) + limit sum price.
    """
    rng = np.random.default_rng(100)
    angle = rng.uniform(0, 6, (2, 100))
    x = (
        rng.normal(0, 0.75, (100, 1))
        - rng.normal(0, 0.75, 100)
        + np.cos(angle[0][:, None] - angle[1])
    )
    scores = rng.binomial(10, expit(x)) / 10
    average = nash_average(scores)
    limit = average.game.value + SLACK

    def dual(price):
        mass = -scores.T @ price
        return logsumexp(mass) + limit * price.sum(), limit - scores @ np.exp(
            mass - logsumexp(mass)
        )

    exact = {"ftol": 1e-16, "gtol": 1e-10, "maxcor": 50, "maxiter": 10**5, "maxfun": 10**5}
    found = minimize(
        dual, np.ones(100), jac=True, bounds=[(0, None)] * 100, method="L-BFGS-B", options=exact
    )
    mass = -scores.T @ found.x
    np.testing.assert_allclose(average.game.attacker_mix, np.exp(mass - logsumexp(mass)), atol=1e-6)


def test_an_attacker_cloned_ten_times_changes_the_mean_score_and_not_the_game():
    cloned = np.column_stack([RANDOM, *[RANDOM[:, 3]] * 10])
    before, after = nash_average(RANDOM), nash_average(cloned)
    assert after.game.value == pytest.approx(before.game.value, abs=1e-10)
    np.testing.assert_allclose(after.defender, before.defender, atol=1e-3)
    assert np.abs(cloned.mean(axis=1) - RANDOM.mean(axis=1)).max() > 0.05


def test_the_order_of_entrants_does_not_matter():
    tied = np.random.default_rng(2).integers(0, 3, (9, 12)) / 2  # full of ties: many equilibria
    rows, columns = (
        np.random.default_rng(0).permutation(9),
        np.random.default_rng(1).permutation(12),
    )
    before, after = nash_average(tied), nash_average(tied[np.ix_(rows, columns)])
    np.testing.assert_allclose(after.defender, before.defender[rows], atol=1e-8)
    np.testing.assert_allclose(after.attacker, before.attacker[columns], atol=1e-8)


def test_averages_are_bounded_by_the_value():
    average = nash_average(RANDOM)
    assert average.defender.max() == pytest.approx(average.game.value, abs=3e-5)
    assert average.attacker.max() == pytest.approx(1 - average.game.value, abs=3e-5)


def test_the_value_of_a_population_and_its_interval_over_start_states():
    # Method b holds the better defender of each attacker; in episode 1 everyone loses, which only
    # the samples can show.
    cause = np.full((3, 2, 20), Cause.REACHED, np.int8)
    cause[0, 0, :10] = cause[1, 0, :10] = cause[2, 1, :10] = Cause.INTERCEPT
    result = build(cause, entrants("d", 1, 3), entrants("a", 1, 2))
    values = population_values(result, {"a": np.array([0]), "b": np.array([1, 2])}, samples=200)
    assert values["a"].value == 0.0  # attacker 1 always beats it
    assert (values["a"].low, values["a"].high) == (0.0, 0.0)
    assert values["b"].value == pytest.approx(0.25)  # half of 10 in 20
    np.testing.assert_allclose(values["b"].defender_mix, 0.5)
    # Won episodes are Binomial(20, 1/2): 95 % of samples have 6 to 14 of them; the value is half
    # of that share.
    assert values["b"].low == pytest.approx(6 / 40, abs=0.026)
    assert values["b"].high == pytest.approx(14 / 40, abs=0.026)


def test_a_game_with_holes_is_refused_and_one_fight_is_a_game():
    with pytest.raises(ValueError, match="every cell"):
        solve(np.array([[0.5, np.nan]]))
    with pytest.raises(ValueError, match="every cell"):
        solve(np.zeros((0, 3)))
    holed = from_letters([["w", "."], ["l", "w"]])
    with pytest.raises(ValueError, match="every cell"):
        population_values(holed, {"a": np.array([0])}, samples=0)
    assert nash_average(np.array([[0.3]])).attacker.tolist() == pytest.approx([0.7])
