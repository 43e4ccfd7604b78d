"""Who is on the panel that every final defender meets."""

import numpy as np
import pytest
from cross_plays import METHODS, NAN, cross_play
from tournaments import build, entrants, from_letters, from_rates

from dronecombat_jax.analysis.compare import (
    compare_methods,
)
from dronecombat_jax.analysis.forgetting import at_home
from dronecombat_jax.analysis.panel import (
    away_panel,
    cells_needed,
    cross_play_cells,
    fill_home,
)
from dronecombat_jax.analysis.result import Alias
from dronecombat_jax.types import Cause


def test_the_panel_is_the_final_and_every_tenth_attacker_of_the_others_and_the_pilots():
    defenders, attackers = entrants("d", 2, 12), entrants("a", 2, 12, scripted=1)
    cause = np.full((24, 25, 1), Cause.TIMEOUT, np.int8)
    # of run 0: it beats the other's tenth and the pilot, loses to the other's final, ties else
    final = 11
    cause[final, 12 + 9] = cause[final, 24] = Cause.INTERCEPT
    cause[final, 12 + 11] = Cause.REACHED
    cause[final, 11] = Cause.INTERCEPT  # its own: must not count
    panel = away_panel(build(cause, defenders, attackers))
    assert panel.runs == ("ippo#0", "ippo#1")
    np.testing.assert_allclose(panel.plain, [2 / 3, 0.5])
    assert panel.fights.tolist() == [3, 3]
    assert panel.groups == ("", "ippo#0", "ippo#1")
    assert panel.weights.tolist() == [1, 2, 2]
    np.testing.assert_allclose(panel.table, [[1, NAN, 0.5], [0.5, 0.5, NAN]])
    # Only the pilot was met by both, and there the first is better by 0.5; so it is at both homes.
    np.testing.assert_allclose(panel.filled, [[1, 1, 0.5], [0.5, 0.5, 0]], atol=1e-12)
    np.testing.assert_allclose(panel.adjusted, [(1 + 2 * 1 + 2 * 0.5) / 5, (0.5 + 2 * 0.5) / 5])


def test_a_policy_saved_again_takes_the_seats_of_all_its_chunks_and_no_second_seed():
    defenders, attackers = entrants("d", 2, 1), entrants("a", 2, 2)
    again = lambda one, **change: Alias(*one[1:7])._replace(**change)
    # The first run's attacker of chunk 9 was left alone in chunk 10, and its last is that of chunk
    # 11.
    attackers[0] = attackers[0]._replace(chunk=9, also=(again(attackers[0], chunk=10),))
    attackers[1] = attackers[1]._replace(chunk=11)
    # A third run, a copy of the second: the same defender and the same last attacker.
    defenders[1] = defenders[1]._replace(also=(again(defenders[1], run="copy"),))
    attackers[3] = attackers[3]._replace(also=(again(attackers[3], run="copy", chunk=2),))
    cause = np.full((2, 4, 1), Cause.TIMEOUT, np.int8)
    cause[0, 3] = cause[1, 0] = Cause.INTERCEPT
    panel = away_panel(build(cause, defenders, attackers))
    assert panel.runs == ("copy#1", "ippo#0") and panel.copies == (("ippo#1", "copy#1"),)
    # chunks 9 = 10 and 11 of the first run, the last of the second
    assert panel.weights.tolist() == [2, 1]
    np.testing.assert_allclose(panel.plain, [0.75, 1.0])
    assert np.isnan(panel.adjusted).all()  # nobody met both of them
    assert panel.fights.tolist() == [2, 1]


def test_a_comparison_needs_no_other_cells_and_misses_none():
    """Every number of it is the same without them."""
    result = cross_play(0.5, seeds=3, episodes=20)
    needed = cells_needed(result.defenders, result.attackers)
    # finals; the others at home; the pilot against finals and pilots
    assert needed.sum() == 6 * 14 + 6 * 2 + 6 + 2
    cause = np.where(needed[..., None], result.cause, Cause.NONE)
    part = build(cause, result.defenders, result.attackers)
    assert compare_methods(part, every=1) == compare_methods(result, every=1)
    assert at_home(part, away_panel(part)) == at_home(result, away_panel(result))
    for row in np.flatnonzero([one.chunk == 2 for one in result.defenders]):
        lost = cause.copy()
        lost[row] = Cause.NONE  # a final defender's cells are needed
        assert compare_methods(build(lost, result.defenders, result.attackers)) != compare_methods(
            result
        )


def test_missing_runs_are_named_and_a_missing_attacker_leaves_the_panel_common():
    defenders, attackers = entrants("d", 4, 1), entrants("a", 4, 1)
    rows = [
        ["ww", "dd", "ll", "ww"],
        ["ww", "ww", "ll", "ww"],
        ["..", "..", "..", ".."],
        ["ww", "ww", "..", "ww"],
    ]
    result = from_letters(rows)._replace(defenders=tuple(defenders), attackers=tuple(attackers))
    panel = away_panel(result)
    assert panel.missing == (("ippo#2", "ippo"),)
    assert panel.dropped == ("a-ippo-2-1",)
    assert panel.runs == ("ippo#0", "ippo#1", "ippo#3")
    np.testing.assert_allclose(panel.plain, [0.75, 1.0, 1.0])
    # (?, 1/2, 1), (1, ?, 1), (1, 1, ?) with 3/4, 3/4, 5/4 filled in: rows' means 9/12, 11/12,
    # 13/12, columns' 11/12, 9/12, 13/12, all cells' 11/12; row + column - all is what is filled in.
    np.testing.assert_allclose(panel.adjusted, [9 / 12, 11 / 12, 13 / 12])


def test_cells_at_home_are_filled_as_a_slow_loop_fills_them():
    rng = np.random.default_rng(5)
    table, weights = rng.random((7, 9)), rng.integers(1, 5, 9).astype(float)
    table[np.arange(7), np.arange(7)] = NAN
    table[3, 0] = NAN
    filled = np.where(np.isnan(table), 0.5, table)
    for _ in range(3000):  # the two-way fit to what is filled, filled in again, until nothing moves
        row, column = filled @ weights / weights.sum(), filled.mean(axis=0)
        fit = row[:, None] + column - row.mean()
        filled = np.where(np.isnan(table), fit, table)
    np.testing.assert_allclose(fill_home(table, weights), filled, atol=1e-9)


def test_what_no_fight_tells_stays_unknown_and_is_no_finding():
    """Two runs that met nobody in common: each one's score may be due to the other's attacker."""
    table = np.array([[NAN, 0.9], [0.2, NAN]])
    assert np.isnan(np.diag(fill_home(table, np.ones(2)))).all()
    result = from_rates(
        np.array([[0.5, 0.9], [0.2, 0.5]]),
        20,
        0,
        defenders=entrants("d", 1, 1, METHODS),
        attackers=entrants("a", 1, 1, METHODS),
    )
    with pytest.raises(ValueError, match="no attacker in common"):
        compare_methods(result)


def test_the_papers_experiment_flies_own_round_robins_and_a_thinned_cross_play():
    """Two seeds of 4 chunks and a pilot a side; every second chunk is in the cross-play."""
    sides = entrants("d", 2, 4, scripted=1), entrants("a", 2, 4, scripted=1)
    asked = cross_play_cells(*sides, every=2)
    in_cross_play = np.asarray([0, 1, 0, 1, 0, 1, 0, 1, 1], bool)
    expected = np.outer(in_cross_play, in_cross_play)
    expected[:4, :4] = expected[4:8, 4:8] = True
    np.testing.assert_array_equal(asked, expected)
    cause = np.where(asked[..., None], Cause.TIMEOUT, Cause.NONE).astype(np.int8)
    panel = away_panel(build(cause, *sides), every=2)
    assert panel.runs == ("ippo#0", "ippo#1") and panel.dropped == () and panel.missing == ()
    assert panel.fights.tolist() == [3, 3]
