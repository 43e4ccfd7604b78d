"""What is observed: late, seldom, noisy, biased, or exactly."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.sensors import see
from dronecombat_jax.config.fields import Config, SensorConfig
from dronecombat_jax.types import SIDES, Craft, EnvState

KEY = jax.random.key(0)
SIZE = 4000
NOISE = SensorConfig(position_noise=0.01, attitude_noise=0.02, velocity_noise=0.1, rate_noise=0.3)
# Where p_d, v_d and w_d stand in an observation (eq. 5); those of the attacker follow the defender's.
POSITION, VELOCITY, RATE = slice(0, 3), slice(17, 20), slice(20, 23)


def many(state: EnvState, sensor: SensorConfig, clock: int = 0) -> np.ndarray:
    """Observations [SIZE, A, 35] of one state by as many fights' sensors."""
    config = replace(Config(), sensor=sensor)
    observation = Combat(config).observation

    def look(word: jax.Array) -> jax.Array:
        noisy = state.replace(clock=jnp.int32(clock), craft=Craft(word=word))
        return see(config, observation, noisy)

    return np.asarray(jax.jit(jax.vmap(look))(jnp.arange(SIZE, dtype=jnp.uint32)))


@pytest.fixture(scope="module")
def still(arena: SimpleNamespace) -> EnvState:
    return arena.combat.reset(KEY)


def test_errors_have_their_deviations_and_each_side_its_own(arena: SimpleNamespace, still):
    exact, seen = np.asarray(arena.combat.observe(still)), many(still, NOISE)
    errors = seen - exact
    deviation = errors.std(axis=0)
    np.testing.assert_allclose(deviation[:, POSITION], 0.01, rtol=0.05)
    np.testing.assert_allclose(deviation[:, VELOCITY], 0.1, rtol=0.05)
    np.testing.assert_allclose(deviation[:, RATE], 0.3, rtol=0.05)
    # gravity in the frame of a level drone that seems to be tilted: two small angles
    np.testing.assert_allclose(deviation[:, 29:31], 0.02, rtol=0.05)
    np.testing.assert_allclose(deviation[:, 14:17], 0.0, atol=1e-7)  # the target is known
    assert np.abs(errors.mean(axis=0)).max() < 0.02
    np.testing.assert_allclose(np.linalg.norm(seen[..., 3:7], axis=-1), 1.0, rtol=1e-5)
    of_sides = [np.corrcoef(errors[:, 0, i], errors[:, 1, i])[0, 1] for i in (0, 17, 20)]
    assert np.abs(of_sides).max() < 0.06


@pytest.mark.parametrize("side", SIDES)
def test_one_side_may_sense_alone(arena: SimpleNamespace, still, side: str):
    exact, seen = np.asarray(arena.combat.observe(still)), many(still, replace(NOISE, side=side))
    own, other = SIDES.index(side), 1 - SIDES.index(side)
    np.testing.assert_array_equal(seen[:, other], np.broadcast_to(exact[other], (SIZE, 35)))
    np.testing.assert_array_equal(seen[:, own], many(still, NOISE)[:, own])


@pytest.mark.long
def test_a_bias_stays_for_the_fight(still):
    """Two measurements share a variance of bias^2 of 1 + bias^2: a correlation of 4/5 with 2."""
    biased = replace(NOISE, bias=2.0)
    first, later = many(still, biased), many(still, biased, clock=7)
    for column in (0, 8, 17, 22):
        pair = np.corrcoef(first[:, 0, column], later[:, 0, column])
        assert pair[0, 1] == pytest.approx(0.8, abs=0.03)
        fresh = np.corrcoef(many(still, NOISE)[:, 0, column], later[:, 0, column])
        assert first[:, 0, column].std() == pytest.approx(
            5**0.5 * many(still, NOISE)[:, 0, column].std(), rel=0.06
        )
        assert fresh[0, 1] < 0.5


@pytest.mark.parametrize(("latency", "period"), [(0, 3), (2, 1), (2, 3)])
@pytest.mark.long
def test_measurements_arrive_late_and_seldom(arena: SimpleNamespace, latency: int, period: int):
    """At clock t the measurement of the latest multiple of the period, at most t - latency, is known."""
    config = replace(Config(), sensor=SensorConfig(latency=latency, period=period))
    combat = Combat(config, arena.combat.scene)
    state = combat.reset(KEY)
    assert state.craft is not None and state.craft.speeds is None and state.craft.word is None
    exact, step = [np.asarray(arena.combat.observe(state))], jax.jit(combat.step)
    for clock in range(1, 10):
        state, output = step(state, jnp.full((2, 4), 0.3 + 0.01 * clock))
        exact.append(np.asarray(arena.combat.observe(state)))
        known = max((clock - latency) // period * period, 0)
        np.testing.assert_allclose(output.observation, exact[known], atol=1e-6)
    assert np.abs(exact[-1] - exact[0]).max() > 0.01


@pytest.mark.long
def test_noise_is_held_with_its_measurement_and_repeated(arena: SimpleNamespace):
    config = replace(Config(), sensor=replace(NOISE, period=2))
    combat = Combat(config, arena.combat.scene)
    start = combat.reset(KEY)
    step, hover = jax.jit(combat.step), jnp.zeros((2, 4)).at[:, 0].set(2 / 1.9 - 1)

    def fly() -> list[np.ndarray]:
        state, seen = start, [np.asarray(combat.observe(start))]
        for _ in range(4):
            state, output = step(state, hover)
            seen.append(np.asarray(output.observation))
        return seen

    seen = fly()
    np.testing.assert_allclose(seen[1], seen[0], atol=1e-6)
    np.testing.assert_allclose(seen[3], seen[2], atol=1e-6)
    assert np.abs(seen[2] - seen[1]).max() > 1e-3
    np.testing.assert_array_equal(seen, fly())
