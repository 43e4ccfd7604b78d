"""The samplers' weights, worked by hand, and what is drawn with them."""

from dataclasses import replace
from typing import get_args, get_type_hints

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from dronecombat_jax.config.fields import SelfPlayConfig
from dronecombat_jax.selfplay.pool import draw
from dronecombat_jax.selfplay.samplers import GRADES, SAMPLERS, Members
from dronecombat_jax.types import Pool

SLOTS = 8
RATES = np.asarray([0.0, 0.25, 0.5, 0.75, 1.0, 0.5, 0.5, 0.5])
MEMBERS = Members(jnp.arange(SLOTS, dtype=jnp.int32), jnp.int32(5), jnp.asarray(RATES, jnp.float32))
SETTINGS = SelfPlayConfig(probability=0.2, delta=0.5, pfsp_power=2.0)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("uniform", [1, 1, 1, 1, 1]),
        ("latest", [0, 0, 0, 0, 1]),
        ("delta_uniform", [0, 0, 1, 1, 1]),  # the newest half of five, rounded up
        ("pfsp_hard", [1, 0.5625, 0.25, 0.0625, 0]),
        ("pfsp_variance", [0, 0.1875, 0.25, 0.1875, 0]),
        # (1 - x)^2 over its sum 1.875, and the newest as much as all of them
        ("latest_and_hard", [8 / 15, 0.3, 2 / 15, 1 / 30, 1]),
    ],
)
def test_weights_of_the_filled_slots(name, expected):
    np.testing.assert_allclose(SAMPLERS[name](MEMBERS, SETTINGS)[:5], expected, atol=1e-7)


@pytest.mark.parametrize(
    ("delta", "expected"), [(0.0, [0, 0, 0, 0, 1]), (0.2, [0, 0, 0, 0, 1]), (1.0, [1, 1, 1, 1, 1])]
)
def test_delta_reaches_from_the_newest_alone_to_the_whole_pool(delta, expected):
    assert (
        SAMPLERS["delta_uniform"](MEMBERS, replace(SETTINGS, delta=delta))[:5].tolist() == expected
    )


def test_every_choice_of_the_setting_is_a_sampler_and_back():
    assert set(SAMPLERS) == set(get_args(get_type_hints(SelfPlayConfig)["sampler"]))


def pool(games: float = 0.0, wins=None) -> Pool:
    wins = jnp.zeros(SLOTS) if wins is None else jnp.asarray(wins, jnp.float32)
    return Pool(policies=None, wins=wins, games=jnp.full(SLOTS, games))  # type: ignore[arg-type]


def drawn(settings: SelfPlayConfig, filled: int, count: int = 4000, **records) -> np.ndarray:
    slots = draw(settings, pool(**records), jnp.int32(filled), jax.random.key(3), (count,))
    assert slots.dtype == jnp.int32
    return np.bincount(np.asarray(slots), minlength=SLOTS)


@pytest.mark.parametrize("filled", [1, 2, 5, SLOTS])
def test_uniform_is_uniform_over_filled_slots_and_never_meets_an_empty_one(filled):
    counts = drawn(SETTINGS, filled)
    assert counts[filled:].sum() == 0
    if filled > 1:
        assert stats.chisquare(counts[:filled]).pvalue > 1e-3


@pytest.mark.parametrize("name", list(SAMPLERS))
def test_no_sampler_meets_an_empty_slot(name):
    settings = replace(SETTINGS, sampler=name)
    for filled in (1, 3):
        assert drawn(settings, filled, count=500)[filled:].sum() == 0


def test_prioritised_draws_follow_the_records():
    """(1 - x)^2 with x by Laplace's rule: 9 of 10 won gives 10/12, none of 10 gives 1/12."""
    wins = [9.0, 0.0, 9.0, 0.0, 0, 0, 0, 0]
    counts = drawn(replace(SETTINGS, sampler="pfsp_hard"), 4, games=10.0, wins=wins)
    weights = np.asarray([2, 11, 2, 11]) ** 2
    assert stats.chisquare(counts[:4], 4000 * weights / weights.sum()).pvalue > 1e-3


def test_half_of_the_draws_are_the_newest_and_half_the_hard_ones():
    """x = 10/12, 1/12, 10/12, 1/12, so (1 - x)^2 is 4, 121, 4, 121 of 250; the newest is slot 3."""
    counts = drawn(replace(SETTINGS, sampler="latest_and_hard"), 4, games=10.0, wins=[9.0, 0.0] * 4)
    shares = 0.5 * np.asarray([4, 121, 4, 121]) / 250 + [0, 0, 0, 0.5]
    assert counts[4:].sum() == 0 and stats.chisquare(counts[:4], 4000 * shares).pvalue > 1e-3


def test_who_has_beaten_everybody_meets_the_newest():
    settings = replace(SETTINGS, sampler="latest_and_hard", pfsp_power=100.0)
    counts = drawn(settings, 4, count=500, games=1000.0, wins=[1000.0] * SLOTS)
    assert counts.tolist() == [0, 0, 0, 500, 0, 0, 0, 0]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("win", [1.0, 1.0, 0.5, 0.0, 0.0]),
        ("rho", [0.75, 0.0, 0.0, 0.0, 0.0]),
        ("margin", [0.875, 0.5, 0.5, 0.5, 0.125]),
    ],
)
def test_grades_of_a_soon_and_a_late_win_a_tie_and_a_late_and_a_soon_loss(name, expected):
    won, tied = np.asarray([1, 1, 0, 0, 0], bool), np.asarray([0, 0, 1, 0, 0], bool)
    rho = np.asarray([0.75, 0.0, 0.0, 0.0, 0.75])  # after a quarter of the time, and at its end
    grades = GRADES[name](jnp.asarray(won), jnp.asarray(tied), jnp.asarray(rho))
    np.testing.assert_allclose(grades, expected)


def test_every_record_of_the_setting_is_a_grade_and_back():
    assert set(GRADES) == set(get_args(get_type_hints(SelfPlayConfig)["record"]))


def test_where_nobody_is_worth_meeting_everybody_is_as_good():
    never = replace(SETTINGS, sampler="pfsp_hard", pfsp_power=100.0)  # (1/1002)^100 is 0 in float32
    counts = drawn(never, 4, games=1000.0, wins=[1000.0] * SLOTS)
    assert counts[4:].sum() == 0 and stats.chisquare(counts[:4]).pvalue > 1e-3
