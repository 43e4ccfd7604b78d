"""Potential-based shaping: what it adds up to, and that it stays out of the reward."""

import itertools
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dronecombat_jax.combat.shaping import shaping
from dronecombat_jax.config.fields import Config, LearnConfig
from dronecombat_jax.types import EnvState

GAMMA = 0.9
SHAPED = Config(learn=LearnConfig(discount=GAMMA, defender_shaping=30.0, attacker_shaping=7.0))


def state(defender, attacker, down=(False, False)) -> EnvState:
    level = [1.0, 0.0, 0.0, 0.0]
    return EnvState(
        qpos=jnp.asarray([*defender, *level, *attacker, *level]),
        qvel=jnp.zeros(12),
        target=jnp.asarray([5.0, 5.0, 1.0]),
        clock=jnp.int32(0),
        down=jnp.asarray(down),
    )


def output(terminated=False, active=(True, True)) -> SimpleNamespace:
    return SimpleNamespace(
        terminated=jnp.asarray(terminated),
        truncated=jnp.asarray(False),
        active=jnp.asarray(active),
    )


def way(start: EnvState) -> np.ndarray:
    """-w |p - goal| of both."""
    places = np.asarray(start.qpos).reshape(2, 7)[:, :3]
    goals = np.stack([places[1], start.target])
    return np.asarray([-30.0, -7.0]) * np.linalg.norm(places - goals, axis=1)


def test_without_weights_there_is_none():
    here = state((0, 5, 1), (0, 0, 1))
    assert shaping(Config(), here, here, output()) is None


def test_a_step_towards_the_goal_earns_its_metres():
    before, after = state((0, 4, 1), (2, 0, 1)), state((0, 3, 1), (3, 0, 1))
    np.testing.assert_allclose(
        shaping(SHAPED, before, after, output()), GAMMA * way(after) - way(before), rtol=1e-6
    )


@pytest.mark.parametrize("end", ["decided", "down"])
def test_whatever_is_flown_it_adds_up_to_the_potential_of_the_start(end):
    """So the best policies stay the best: the sum holds nothing of what was flown."""
    places = jax.random.uniform(jax.random.key(2), (20, 2, 3), minval=1.0, maxval=5.0)
    flown = [state(*place) for place in places]
    total = np.zeros(2)
    for step, (before, after) in enumerate(itertools.pairwise(flown)):
        last = step == len(flown) - 2
        if last and end == "down":
            after = after.replace(down=jnp.asarray([True, True]))
        gained = shaping(SHAPED, before, after, output(terminated=last and end == "decided"))
        total += GAMMA**step * np.asarray(gained)
    np.testing.assert_allclose(total, -way(flown[0]), rtol=1e-5)


def test_who_takes_no_part_earns_nothing():
    before = state((0, 4, 1), (2, 0, 1), down=(True, False))
    after = state((0, 4, 1), (3, 0, 1), down=(True, False))
    gained = shaping(SHAPED, before, after, output(active=(False, True)))
    assert gained[0] == 0.0 and gained[1] > 0.0
