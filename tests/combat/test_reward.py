"""The reward of eq. 9-12 with its numbers worked by hand."""

from dataclasses import replace

import numpy as np
import pytest

from dronecombat_jax.combat.games import game_of
from dronecombat_jax.combat.reward import total
from dronecombat_jax.combat.rules import Events
from dronecombat_jax.config.fields import Config, GameConfig, RewardConfig
from dronecombat_jax.types import Cause, Drones, RewardTerms

# |p_d - p_a| = 3, |p_a - p_t| = 5; |v|^2 = 9 and 4; |w|^2 = 25 and 100.
DRONES = Drones(
    position=np.array([[0, 4, 1], [0, 1, 1]], np.float32),
    quaternion=np.array([[1, 0, 0, 0], [0, 1, 0, 0]], np.float32),
    velocity=np.array([[1, 2, -2], [2, 0, 0]], np.float32),
    rate=np.array([[0, 3, 4], [-10, 0, 0]], np.float32),
)
TARGET = np.array([4, 4, 1], np.float32)

# 50 (1 - tanh(3 / 5)) and 50 (1 - tanh(5 / 5)): tanh 0.6 = 0.5370496, tanh 1 = 0.7615942
APPROACH = np.array([23.147522, 11.920292])
LINEAR = np.array([-0.05 * 9, -0.05 * 4])
ANGULAR = np.array([-0.01 * 25, -0.01 * 100])
NOTHING = RewardTerms(*(np.zeros(2) for _ in RewardTerms._fields))


def terms_of(
    config: Config, cause: Cause = Cause.NONE, crashed=(False, False), down=(False, False)
) -> RewardTerms:
    """The terms of one step in which `crashed` went down, with `down` down before."""
    crashed, down, no = np.array(crashed), np.array(down), np.array(False)
    events = Events(no, no, crashed, crashed | down, no)
    return game_of(config).reward(config, DRONES, TARGET, events, down, np.int32(cause))


def dense(share: np.ndarray | float) -> RewardTerms:
    return NOTHING._replace(
        approach=share * APPROACH, linear_velocity=share * LINEAR, angular_velocity=share * ANGULAR
    )


def assert_terms(found: RewardTerms, expected: RewardTerms) -> None:
    for name, got, want in zip(RewardTerms._fields, found, expected, strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-5, atol=1e-7, err_msg=name)


def game(**settings) -> Config:
    return Config(game=GameConfig(**settings))


def test_a_step_of_the_default_reward():
    """dt = 0.02: defender 0.462950 - 0.009 - 0.005, attacker 0.238406 - 0.004 - 0.020."""
    terms = terms_of(Config())
    assert_terms(terms, dense(0.02))
    np.testing.assert_allclose(total(terms), [0.448950, 0.214406], atol=1e-5)


def test_a_step_of_the_literal_reward():
    terms = terms_of(Config(reward=RewardConfig(time_scaled=False)))
    assert_terms(terms, dense(1.0))
    np.testing.assert_allclose(total(terms), [22.447522, 10.720292], rtol=1e-6)


def test_the_time_scale_is_the_control_step():
    config = Config()
    slow = replace(config, sim=replace(config.sim, substeps=5))
    assert_terms(terms_of(slow), dense(0.05))


def test_weights_are_settings():
    weights = RewardConfig(
        approach_weight=10, defender_distance_scale=3, attacker_distance_scale=2.5, linear_velocity_penalty=1.0,
        angular_velocity_penalty=0.0,
    )  # fmt: skip
    terms = terms_of(Config(reward=weights))
    # 0.2 (1 - tanh 1), 0.2 (1 - tanh 2), tanh 2 = 0.9640276
    np.testing.assert_allclose(terms.approach, [0.0476812, 0.00719449], rtol=1e-4)
    np.testing.assert_allclose(terms.linear_velocity, [-0.18, -0.08], rtol=1e-5)
    np.testing.assert_array_equal(terms.angular_velocity, [0, 0])


@pytest.mark.parametrize(
    ("cause", "crashed", "win", "lose", "crash"),
    [
        (Cause.NONE, (False, False), (0, 0), (0, 0), (0, 0)),
        (Cause.INTERCEPT, (False, False), (300, 0), (0, -300), (0, 0)),
        (Cause.REACHED, (False, False), (0, 300), (-300, 0), (0, 0)),
        (Cause.DEFENDER_CRASH, (True, False), (0, 300), (0, 0), (-10, 0)),
        (Cause.ATTACKER_CRASH, (False, True), (300, 0), (0, 0), (0, -10)),
        (Cause.BOTH_CRASH, (True, True), (0, 0), (0, 0), (-10, -10)),
        (Cause.TIMEOUT, (False, False), (0, 0), (0, 0), (0, 0)),
        (Cause.INTERCEPT, (False, True), (300, 0), (0, -300), (0, -10)),  # caught while it crashed
        (Cause.REACHED, (True, False), (0, 300), (-300, 0), (-10, 0)),
    ],
)
def test_events_of_the_paper(cause, crashed, win, lose, crash):
    terms = terms_of(Config(), cause, crashed)
    expected = dense(0.02)._replace(win=np.array(win), lose=np.array(lose), crash=np.array(crash))
    assert_terms(terms, expected)
    np.testing.assert_allclose(total(terms), np.sum(np.array(expected), axis=0), rtol=1e-6)


def test_every_prize_and_price_has_its_own_setting():
    prices = RewardConfig(
        win=1,
        lose=20,
        intercepted=30,
        crash_penalty=300,
        crash_win=4000,
        timeout_win=50000,
        timeout_penalty=60000,
    )
    config = Config(reward=prices, game=GameConfig(timeout_rule="defender"))
    total_of = lambda *event: np.asarray(
        total(terms_of(config, *event)) - total(dense(0.02))
    ).round()
    np.testing.assert_array_equal(total_of(Cause.INTERCEPT), [1, -30])
    np.testing.assert_array_equal(total_of(Cause.REACHED), [-20, 1])
    np.testing.assert_array_equal(total_of(Cause.DEFENDER_CRASH, (True, False)), [-300, 4000])
    np.testing.assert_array_equal(total_of(Cause.ATTACKER_CRASH, (False, True)), [4000, -300])
    np.testing.assert_array_equal(total_of(Cause.TIMEOUT), [50000, -60000])


def test_time_out_costs_only_under_its_rule():
    np.testing.assert_array_equal(
        terms_of(game(timeout_rule="draw"), Cause.TIMEOUT).timeout, [0, 0]
    )
    np.testing.assert_array_equal(
        terms_of(game(timeout_rule="defender"), Cause.TIMEOUT).timeout, [300, -300]
    )
    np.testing.assert_array_equal(
        terms_of(game(timeout_rule="defender"), Cause.INTERCEPT).timeout, [0, 0]
    )


def test_out_a_downed_drone_pays_once_and_then_earns_nothing():
    config = game(crash_rule="out")
    falls = terms_of(config, crashed=(True, False))
    assert_terms(falls, dense(0.02)._replace(crash=np.array([-10, 0])))
    assert_terms(terms_of(config, down=(True, False)), dense(0.02 * np.array([0, 1])))


def test_grounded_a_downed_drone_is_rewarded_as_ever_and_pays_at_every_step():
    config = game(crash_rule="grounded")
    for down in ({"crashed": (True, False)}, {"down": (True, False)}):
        assert_terms(terms_of(config, **down), dense(0.02)._replace(crash=np.array([-10, 0])))


@pytest.mark.parametrize("crash_rule", ["ends", "out", "grounded"])
def test_solo_the_absent_defender_neither_earns_nor_pays(crash_rule):
    config = game(scenario="solo", crash_rule=crash_rule)
    assert_terms(terms_of(config, down=(True, False)), dense(0.02 * np.array([0, 1])))
    crash = terms_of(config, Cause.ATTACKER_CRASH, (False, True), (True, False))
    assert crash.crash.tolist() == [0, -10]
