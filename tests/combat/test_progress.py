"""The reward for the way to one's goal: its metres, and that it stays out of the game's reward."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np

from dronecombat_jax.combat.progress import progress
from dronecombat_jax.config.fields import Config, LearnConfig
from dronecombat_jax.types import EnvState

WEIGHTS = np.asarray([30.0, 7.0])
REWARDED = Config(learn=LearnConfig(defender_progress=30.0, attacker_progress=7.0))


def state(defender, attacker, down=(False, False)) -> EnvState:
    level = [1.0, 0.0, 0.0, 0.0]
    return EnvState(
        qpos=jnp.asarray([*defender, *level, *attacker, *level]),
        qvel=jnp.zeros(12),
        target=jnp.asarray([5.0, 5.0, 1.0]),
        clock=jnp.int32(0),
        down=jnp.asarray(down),
    )


def output(active=(True, True)) -> SimpleNamespace:
    return SimpleNamespace(active=jnp.asarray(active))


def earned(before: EnvState, after: EnvState, active=(True, True)) -> np.ndarray:
    gained = progress(REWARDED, before, after, output(active))
    assert gained is not None
    return np.asarray(gained)


def distances(fight: EnvState) -> np.ndarray:
    """Defender to attacker, attacker to target."""
    places = np.asarray(fight.qpos).reshape(2, 7)[:, :3]
    goals = np.stack([places[1], fight.target])
    return np.linalg.norm(places - goals, axis=1)


def test_without_weights_there_is_none():
    here = state((0, 5, 1), (0, 0, 1))
    assert progress(Config(), here, here, output()) is None


def test_a_step_earns_the_metres_that_it_came_nearer():
    before, after = state((0, 4, 1), (2, 0, 1)), state((0, 3, 1), (3, 0, 1))
    nearer = distances(before) - distances(after)
    np.testing.assert_allclose(earned(before, after), WEIGHTS * nearer, rtol=1e-5)


def test_a_defender_can_be_drawn_to_a_post_before_the_target():
    """0.3 m from (5, 5, 1) towards the attacker; half-way where the attacker is nearer than that."""
    config = replace(REWARDED, learn=replace(REWARDED.learn, defender_post=0.3))

    def earned(before: EnvState, after: EnvState) -> np.ndarray:
        return np.asarray(progress(config, before, after, output()))

    before, after = state((5, 0, 1), (2, 5, 1)), state((5, 3, 1), (5, 9, 1))
    nearer = np.hypot(5.0, 0.3) - 2.3, 3.0 - 4.0
    np.testing.assert_allclose(earned(before, after), WEIGHTS * nearer, rtol=1e-5)
    close, at_it = state((5, 4, 1), (5, 5.4, 1)), state((5, 4.5, 1), (5, 5, 1))
    nearer = 1.2 - 0.5, 0.4
    np.testing.assert_allclose(earned(close, at_it), WEIGHTS * nearer, rtol=1e-5)


def test_over_a_fight_it_adds_up_to_the_way_gained():
    places = jax.random.uniform(jax.random.key(2), (20, 2, 3), minval=1.0, maxval=5.0)
    flown = [state(*place) for place in places]
    steps = [earned(before, after) for before, after in itertools.pairwise(flown)]
    gained = distances(flown[0]) - distances(flown[-1])
    np.testing.assert_allclose(np.sum(steps, axis=0), WEIGHTS * gained, rtol=1e-4)


def test_a_drone_earns_on_the_step_in_which_it_goes_down_and_never_after():
    before, falls = state((0, 4, 1), (2, 0, 1)), state((0, 3, 1), (3, 0, 1), down=(True, False))
    assert np.all(earned(before, falls) > 0.0)
    later = falls.replace(
        qpos=falls.qpos.at[7].add(1.0)
    )  # it lies there, and the attacker flies on
    assert earned(falls, later, (False, True))[0] == 0.0
