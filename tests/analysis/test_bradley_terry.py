"""Bradley-Terry and Davidson: against other implementations, planted truths, and where the data say
too little.
"""

import choix
import evalica
import numpy as np
import pytest
from tournaments import bradley_terry_rates

from dronecombat_jax.analysis.bradley_terry import POINTS, bradley_terry, contrast, davidson
from dronecombat_jax.analysis.design import BOUNDED, OPEN_ABOVE, OPEN_BELOW, OPEN_BOTH, design_of

SIZE = (6, 5)
STRENGTH = np.random.default_rng(1).normal(size=sum(SIZE))
RATE = bradley_terry_rates(STRENGTH[: SIZE[0]], STRENGTH[SIZE[0] :])
WINS = np.random.default_rng(2).binomial(20, RATE)
NOTHING = np.zeros(SIZE, int)
TRINOMIAL = np.random.default_rng(3).multinomial(
    20, np.stack([RATE * 0.7, 0.3 + 0 * RATE, 0.7 - RATE * 0.7], -1)
)


def strengths(ratings):
    return (ratings.rating - 1500) / POINTS


def pairs(wins, losses):
    """(winner, loser) of every decided fight."""
    won = [(i, SIZE[0] + j) for i, j in np.ndindex(*SIZE) for _ in range(wins[i, j])]
    return won + [(SIZE[0] + j, i) for i, j in np.ndindex(*SIZE) for _ in range(losses[i, j])]


def evalica_fights(wins, ties, losses):
    kinds = ((wins, evalica.Winner.X), (ties, evalica.Winner.Draw), (losses, evalica.Winner.Y))
    fights = [
        (i, SIZE[0] + j, how)
        for i, j in np.ndindex(*SIZE)
        for n, how in kinds
        for _ in range(int(n[i, j]))
    ]
    return [list(column) for column in zip(*fights, strict=True)]


def centred(values):
    values = np.asarray(values)
    return values - values.mean()


def test_the_maximum_agrees_with_choix():
    theirs = choix.opt_pairwise(sum(SIZE), pairs(WINS, 20 - WINS), alpha=0.0, tol=1e-13)
    ours = bradley_terry(WINS, 20 - WINS, NOTHING, prior_sd=None)
    np.testing.assert_allclose(strengths(ours), centred(theirs), atol=1e-9)


def test_the_prior_agrees_with_choix():
    # choix's penalty is alpha * sum(theta^2), so the variance of the prior is 1 / (2 alpha).
    theirs = choix.opt_pairwise(sum(SIZE), pairs(WINS, 20 - WINS), alpha=0.3, tol=1e-13)
    ours = bradley_terry(WINS, 20 - WINS, NOTHING, prior_sd=POINTS / np.sqrt(0.6))
    np.testing.assert_allclose(strengths(ours), centred(theirs), atol=1e-9)


def test_ties_as_halves_agree_with_evalica():
    wins, ties, losses = np.moveaxis(TRINOMIAL, -1, 0)
    theirs = evalica.bradley_terry(
        *evalica_fights(wins, ties, losses), tolerance=1e-15, limit=10**5
    )
    ours = bradley_terry(wins, losses, ties, prior_sd=None)
    np.testing.assert_allclose(
        strengths(ours), centred(np.log(theirs.scores.sort_index())), atol=1e-12
    )


def test_davidson_agrees_with_evalicas_newman_with_nu_twice_its_v():
    wins, ties, losses = np.moveaxis(TRINOMIAL, -1, 0)
    theirs = evalica.newman(*evalica_fights(wins, ties, losses), tolerance=1e-15, limit=10**5)
    ours = davidson(wins, losses, ties, prior_sd=None)
    np.testing.assert_allclose(
        strengths(ours), centred(np.log(theirs.scores.sort_index())), atol=1e-12
    )
    assert ours.tie == pytest.approx(2 * theirs.v, abs=1e-12)


def test_one_pair_worked_by_hand():
    # 3 wins and 1 loss: x = log 3, so 190.85 points apart. Information 4 * 3/4 * 1/4 = 0.75:
    # variance of x is 4/3, and of each strength, half of x, 1/3: 0.57735 * 173.718 = 100.30 points.
    ratings = bradley_terry(np.array([[3]]), np.array([[1]]), np.array([[0]]), prior_sd=None)
    np.testing.assert_allclose(ratings.rating, [1595.424, 1404.576], atol=1e-3)
    np.testing.assert_allclose(ratings.error, 100.296, atol=1e-3)
    np.testing.assert_allclose(contrast(ratings, 0, 1), [190.849, 200.592], atol=1e-3)


@pytest.mark.parametrize("model", ["bradley_terry", "davidson"])
def test_95_percent_intervals_cover_the_planted_truth(model):
    rng = np.random.default_rng(5)
    inside = []
    for _ in range(400):
        strength = centred(rng.normal(0, 0.6, 14))
        x = strength[:7, None] - strength[None, 7:]
        if model == "davidson":
            weight = np.stack([np.exp(x / 2), 0.8 + 0 * x, np.exp(-x / 2)], -1)
            wins, ties, losses = np.moveaxis(
                rng.multinomial(20, weight / weight.sum(-1, keepdims=True)), -1, 0
            )
            ratings = davidson(wins, losses, ties)
        else:
            wins = rng.binomial(20, 1 / (1 + np.exp(-x)))
            ratings = bradley_terry(wins, 20 - wins, 0 * wins)
        truth = 1500 + POINTS * strength
        inside.append((ratings.low < truth) & (truth < ratings.high))
    assert 0.93 < np.mean(inside) < 0.97


def test_stronger_attackers_leave_contrasts_within_a_side_alone():
    fit = lambda shift: bradley_terry(*expected(shift), 0 * RATE, prior_sd=None).rating
    expected = lambda shift: (
        20 * bradley_terry_rates(STRENGTH[:6], STRENGTH[6:] + shift),
        20 * (1 - bradley_terry_rates(STRENGTH[:6], STRENGTH[6:] + shift)),
    )
    before, after = fit(0.0), fit(1.3)
    np.testing.assert_allclose(np.diff(after[:6]), np.diff(before[:6]), atol=1e-10)
    np.testing.assert_allclose(np.diff(after[6:]), np.diff(before[6:]), atol=1e-10)
    assert after[6] - after[0] - (before[6] - before[0]) == pytest.approx(1.3 * POINTS)
    assert after.mean() == pytest.approx(1500)


def test_the_order_of_entrants_does_not_matter():
    rows, columns = np.random.default_rng(0).permutation(6), np.random.default_rng(1).permutation(5)
    straight = bradley_terry(WINS, 20 - WINS, NOTHING)
    shuffled = bradley_terry(
        *(table[np.ix_(rows, columns)] for table in (WINS, 20 - WINS, NOTHING))
    )
    order = [*rows, *(6 + columns)]
    np.testing.assert_allclose(shuffled.rating, straight.rating[order], atol=1e-9)
    np.testing.assert_allclose(shuffled.error, straight.error[order], atol=1e-9)


def test_dispersion_is_one_at_additive_truth_and_more_with_a_cycle():
    rng = np.random.default_rng(4)
    x = rng.normal(size=(20, 1)) - rng.normal(size=(1, 20))
    angle = rng.uniform(0, 2 * np.pi, (2, 20))
    cycle = np.cos(angle[0][:, None] - angle[1])
    rate = lambda x: rng.binomial(50, 1 / (1 + np.exp(-x)))
    dispersion = lambda wins: bradley_terry(wins, 50 - wins, 0 * wins).dispersion
    assert dispersion(rate(x)) == pytest.approx(1.0, abs=0.25)  # 361 degrees of freedom: sd 0.074
    assert dispersion(rate(x + cycle)) > 2


@pytest.mark.parametrize(("wins", "losses", "bounds"), [
    # D0 never loses, the others beat each other: D0 is open above.
    ([[5, 5], [2, 3]], [[0, 0], [3, 2]], [OPEN_ABOVE, BOUNDED, BOUNDED, BOUNDED]),
    # A1 never wins.
    ([[2, 5], [3, 5]], [[3, 0], [2, 0]], [BOUNDED, BOUNDED, BOUNDED, OPEN_BELOW]),
    # One fight: neither is a reference for the other.
    ([[5]], [[0]], [OPEN_ABOVE, OPEN_BELOW]),
    # D0 and A0 beat each other and everyone else: two equal groups, one above the other.
    ([[2, 4], [0, 2]], [[2, 0], [4, 2]], [OPEN_ABOVE, OPEN_BELOW, OPEN_ABOVE, OPEN_BELOW]),
    # A chain D0 > A0 > D1 > A1: the middle is open both ways.
    ([[3, 0], [0, 3]], [[0, 0], [3, 0]], [OPEN_ABOVE, OPEN_BOTH, OPEN_BOTH, OPEN_BELOW]),
    # Nobody has fought.
    ([[0]], [[0]], [OPEN_BOTH, OPEN_BOTH]),
])  # fmt: skip
def test_who_is_bounded(wins, losses, bounds):
    assert design_of(np.array(wins), np.array(losses)).bound.tolist() == bounds


def test_ties_bound_on_both_sides():
    wins, losses, ties = np.array([[5, 4]]), np.array([[0, 0]]), np.array([[0, 1]])
    assert design_of(wins, losses, ties).bound.tolist() == [BOUNDED, OPEN_BELOW, BOUNDED]


@pytest.mark.parametrize("model", [bradley_terry, davidson])
def test_an_unbeaten_player_is_finite_and_its_interval_open(model):
    wins, losses = np.array([[10, 10], [5, 6]]), np.array([[0, 0], [5, 4]])
    ratings = model(wins, losses, 0 * wins)
    assert np.isfinite(ratings.rating).all()
    assert ratings.high[0] == np.inf
    assert np.isfinite(ratings.high[1:]).all()
    # At the low end, ten wins over each of the two have a probability of 2.5 %.
    x = (ratings.low[0] - ratings.rating[2:]) / POINTS
    chance = np.exp(x / 2) / (np.exp(x / 2) + ratings.tie + np.exp(-x / 2))
    assert np.prod(chance**10) == pytest.approx(0.025)
    assert ratings.low[0] < ratings.rating[0]
    # Seen from the attackers' side the same fights give the mirror image.
    mirror = model(losses.T, wins.T, 0 * wins)
    np.testing.assert_allclose(mirror.rating, ratings.rating[[2, 3, 0, 1]], atol=1e-8)
    np.testing.assert_allclose(mirror.low, ratings.low[[2, 3, 0, 1]], atol=1e-6)


def test_a_winless_player_has_no_lower_end():
    wins, losses = np.array([[0, 0], [5, 6]]), np.array([[10, 10], [5, 4]])
    ratings = bradley_terry(wins, losses, 0 * wins)
    assert ratings.low[0] == -np.inf
    chance = 1 / (1 + np.exp((ratings.high[0] - ratings.rating[2:]) / POINTS))
    assert np.prod(chance**10) == pytest.approx(0.025)
    assert ratings.rating[0] < ratings.high[0]


@pytest.mark.parametrize("model", [bradley_terry, davidson])
def test_only_ties_put_everyone_at_the_mean(model):
    ratings = model(np.zeros((2, 3)), np.zeros((2, 3)), np.full((2, 3), 4))
    np.testing.assert_allclose(ratings.rating, 1500)
    assert np.isfinite(ratings.low).all() and np.isfinite(ratings.high).all()
    assert np.isfinite(ratings.tie)


def test_parts_that_never_met_are_not_comparable():
    wins, losses = np.array([[3, 0], [0, 6]]), np.array([[1, 0], [0, 2]])
    ratings = bradley_terry(wins, losses, 0 * wins, prior_sd=None)
    assert ratings.design.component[0] == ratings.design.component[2] != ratings.design.component[1]
    np.testing.assert_allclose(ratings.rating, [1595.424, 1595.424, 1404.576, 1404.576], atol=1e-3)
    # as one pair's
    np.testing.assert_allclose(ratings.error, np.array([1, 2, 1, 2]) ** -0.5 * 100.296, atol=1e-3)
    assert np.isnan(contrast(ratings, 0, 1)).all()


def test_an_entrant_without_fights_is_flagged():
    ratings = bradley_terry(np.array([[3, 0]]), np.array([[2, 0]]), np.array([[0, 0]]))
    assert ratings.rating[2] == 1500
    assert (ratings.low[2], ratings.high[2], ratings.error[2]) == (-np.inf, np.inf, np.inf)
    assert ratings.design.games.tolist() == [5, 5, 0]


def test_without_a_prior_what_has_no_maximum_is_refused():
    with pytest.raises(ValueError, match="prior"):
        bradley_terry(np.array([[5]]), np.array([[0]]), np.array([[0]]), prior_sd=None)
    with pytest.raises(ValueError, match="prior"):
        davidson(WINS, 20 - WINS, NOTHING, prior_sd=None)
