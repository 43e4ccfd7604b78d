"""The search for the goalkeeper's numbers."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tune_goalkeeper as tune

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.guidance import KEEPER
from dronecombat_jax.config import settings
from dronecombat_jax.errors import UserError


def test_numbers_and_goalkeeper_are_each_others():
    assert tune.keeper_of(tune.numbers_of(KEEPER)) == KEEPER


def test_the_score_is_the_mean_and_the_least_half_each():
    assert tune.score(np.asarray([[1.0, 0.5], [0.0, 0.2]])).tolist() == pytest.approx([0.625, 0.05])


def test_the_search_comes_near_to_where_the_shares_are_high():
    start = tune.numbers_of(KEEPER)
    wanted = start + 1.5 * tune.SPREAD

    def count(numbers: np.ndarray, key: jax.Array) -> np.ndarray:
        away = np.square((numbers - wanted) / tune.SPREAD)
        return np.asarray([1.0 - away.sum() / 100.0, 1.0 - away.max() / 100.0])

    search = tune.improved(count, start, 40, np.random.default_rng(0))
    *_, (centre, stopped) = itertools.islice(search, 12)
    assert np.abs((centre - wanted) / tune.SPREAD).max() < 0.5 and tune.score(stopped) > 0.98


@pytest.mark.long
def test_fights_are_those_of_the_pilot_of_these_numbers():
    """One that stays where it is is passed by nearly every dash; the package's stops them."""
    fly = tune.shares(Combat(settings.load("duel")), ["dash"], 32)
    still = np.maximum(tune.numbers_of(KEEPER) * np.asarray([1, 1, 0, 0, 0, 1, 0, 1]), 1e-6)
    assert fly(jnp.asarray(tune.numbers_of(KEEPER)), jax.random.key(0))[0] >= 0.9
    assert fly(jnp.asarray(still), jax.random.key(0))[0] <= 0.3


def test_who_does_not_attack_is_refused():
    with pytest.raises(UserError, match="hover: no attacker"):
        tune.shares(Combat(settings.load("duel")), ["hover"], 4)
