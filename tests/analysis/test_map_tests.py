"""Where two methods' win-rate maps differ."""

import numpy as np
import pytest

from dronecombat_jax.analysis.forgetting import RunMap
from dronecombat_jax.analysis.map_tests import map_tests, summary

CHUNKS = np.array([1, 2, 3])


def maps(method: str, lift: float, seeds: int = 4, hole: bool = False) -> tuple[RunMap, ...]:
    """Each seed's map, `lift` better where the second defender meets the third attacker."""
    made = []
    for seed in range(seeds):
        score = 0.5 + np.random.default_rng([seed, int(100 * lift)]).normal(0, 0.02, (3, 3))
        score[1, 2] += lift
        if hole and seed == 0:
            score[0, 0] = np.nan
        made.append(RunMap(f"{method}#{seed}", method, seed, CHUNKS, score))
    return tuple(made)


def test_the_planted_cell_is_found_with_its_chunks_and_what_a_seed_lacks_is_not_tested():
    (test,) = map_tests({"a": maps("a", 0.4), "b": maps("b", 0.0, hole=True)})
    assert (test.first, test.second, test.seeds) == ("a", "b", (4, 4))
    assert test.defenders.tolist() == test.attackers.tolist() == [1, 2, 3]
    assert test.difference[1, 2] == pytest.approx(0.4, abs=0.05)
    assert test.adjusted_p[1, 2] == pytest.approx(2 / 70) and np.isnan(test.adjusted_p[0, 0])
    assert np.sum(test.adjusted_p < 0.05) == 1
    assert "1 of 8 cells differ" in summary(test)


def test_with_three_seeds_nothing_can_be_found_and_that_is_said():
    (test,) = map_tests({"a": maps("a", 0.4, 3), "b": maps("b", 0.0, 3)})
    assert "0 of 9 cells" in summary(test) and "none could have differed" in summary(test)


def test_methods_without_a_common_cell_are_not_compared():
    empty = [one._replace(score=np.full((3, 3), np.nan)) for one in maps("b", 0.0)]
    assert map_tests({"a": maps("a", 0.4), "b": tuple(empty), "c": ()}) == ()
