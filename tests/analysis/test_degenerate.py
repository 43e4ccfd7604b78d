"""Every rating and statistic on results that say too little (FAULTS row 39): finite, flagged,
nothing made up.
"""

import numpy as np
import pytest
from tournaments import build, entrants, from_letters

from dronecombat_jax.analysis.alpha_rank import alpha_rank
from dronecombat_jax.analysis.behaviour import endings
from dronecombat_jax.analysis.bradley_terry import bradley_terry, davidson
from dronecombat_jax.analysis.compare import compare_methods
from dronecombat_jax.analysis.cyclic import cyclic_share
from dronecombat_jax.analysis.design import BOUNDED, complete_part
from dronecombat_jax.analysis.elo import elo_ratings
from dronecombat_jax.analysis.forgetting import forgetting, run_maps
from dronecombat_jax.analysis.nash import nash_average
from dronecombat_jax.analysis.random_walk import random_walk_curve, timelines
from dronecombat_jax.analysis.result import score_rate, scores
from dronecombat_jax.types import ATTACKER, DEFENDER

# name: the fights, how many of the players have an open end, into how many parts that never met
# they fall
RESULTS = {
    "unbeaten attacker": ([["lll", "wld"], ["lll", "dww"]], 1, 1),
    "winless defender and unbeaten attacker": ([["lll", "lll"], ["lll", "wwl"]], 2, 1),
    "only ties": ([["ddd", "ddd"], ["ddd", "ddd"]], 0, 1),
    "only wins": ([["www", "www"], ["www", "www"]], 4, 1),
    "one pair": ([["wwl"]], 0, 1),
    "one fight": ([["w"]], 2, 1),
    "disconnected": ([["wl", ".."], ["..", "dd"]], 0, 2),
    "an entrant that never fought": ([["wl", ".."], ["ld", ".."]], 1, 2),
}


@pytest.mark.parametrize("name", RESULTS)
@pytest.mark.parametrize("model", [bradley_terry, davidson])
def test_ratings_are_finite_and_their_open_ends_flagged(name, model):
    letters, num_open, parts = RESULTS[name]
    table = scores(from_letters(letters))
    ratings = model(table.wins, table.losses, table.ties)
    is_open = ratings.design.bound != BOUNDED
    assert np.isfinite(ratings.rating).all()
    assert is_open.sum() == num_open
    assert len(np.unique(ratings.design.component)) == parts
    np.testing.assert_array_equal(np.isinf(ratings.low) | np.isinf(ratings.high), is_open)
    assert (ratings.low < ratings.rating).all() and (ratings.rating < ratings.high).all()


@pytest.mark.parametrize("name", RESULTS)
def test_elo_and_the_curve_are_finite(name):
    result = from_letters(RESULTS[name][0])
    table = scores(result)
    elo = elo_ratings(result, orders=2)
    assert np.isfinite([*elo.defender, *elo.attacker]).all()
    assert (
        elo.defender_games.sum()
        == elo.attacker_games.sum()
        == table.wins.sum() + table.ties.sum() + table.losses.sum()
    )
    curve = random_walk_curve(table.wins, table.losses, table.ties, timelines(result))
    assert np.isfinite(curve.ratings.rating).all() and np.isfinite(curve.log_evidence)


@pytest.mark.parametrize("name", RESULTS)
def test_matrix_statistics_use_the_part_that_was_played(name):
    result = from_letters(RESULTS[name][0])
    whole = complete_part(result)
    assert whole.played.all() and whole.played.size > 0
    rate, table = score_rate(whole), scores(whole)
    average = nash_average(rate)
    assert 0 <= average.game.value <= 1 and average.game.gap < 3e-5
    assert alpha_rank(rate).profile.sum() == pytest.approx(1)
    share = cyclic_share(table.wins, table.losses, table.ties, 20)
    assert 0 < share.p_value <= 1 and 0 <= share.corrected <= 1


@pytest.mark.parametrize("name", RESULTS)
def test_rates_and_endings_are_missing_exactly_where_nothing_was_played(name):
    result = from_letters(RESULTS[name][0])
    np.testing.assert_array_equal(np.isnan(score_rate(result)), ~result.played)
    for role, axis in ((DEFENDER, 1), (ATTACKER, 0)):
        share = endings(result, role).share.sum(axis=1)
        np.testing.assert_allclose(share, np.where(result.played.any(axis=axis), 1.0, np.nan))
    (run,) = run_maps(result)
    assert forgetting(run.score).pairs.sum() == result.played.sum()


def test_only_ties_leave_methods_undecided_or_equal_but_never_ranked():
    methods = ("a", "b")
    result = build(
        np.full((8, 8, 5), 6, np.int8), entrants("d", 4, 1, methods), entrants("a", 4, 1, methods)
    )
    (told,) = compare_methods(result)
    assert told.p_value == 1 and told.adjusted_score.difference == 0
    assert told.verdict == "a and b are equivalent within 25 Elo"
    assert np.isnan(told.effect)
