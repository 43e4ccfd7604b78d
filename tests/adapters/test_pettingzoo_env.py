"""The PettingZoo view: each step is the core's own, and PettingZoo's own tests pass."""

import warnings

import jax
import numpy as np
import pytest
from both_views import compare_pettingzoo, pairs
from brax_views import LENGTH
from pettingzoo.test import parallel_api_test, parallel_seed_test, render_test
from pettingzoo.utils.conversions import parallel_to_aec
from toy import UNOPTIMISED, Coasting

from dronecombat_jax.adapters import check
from dronecombat_jax.adapters.pettingzoo_env import CombatParallelEnv
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.machine import rendering
from dronecombat_jax.types import Cause


def coasting(**game) -> Combat:
    return Coasting(Config(game=GameConfig(**{"episode_steps": LENGTH} | game)))


@pytest.fixture(scope="module")
def duel() -> Combat:
    return coasting()


HOLD = np.float32([0.5, 0.0, 0.0, 0.0])


def both(action=HOLD) -> dict:
    return {"defender": action, "attacker": action}


def test_each_step_is_the_cores(duel: Combat):
    core = jax.jit(duel.step, compiler_options=UNOPTIMISED)
    count = compare_pettingzoo(CombatParallelEnv(duel), core, pairs(LENGTH, 12))
    assert count.terminated >= 3 and count.truncated >= 4


@pytest.mark.slow
def test_each_step_of_1000_fights_is_the_cores():
    combat = Combat(Config(game=GameConfig(episode_steps=40, spawn="uniform")))
    actions = pairs(40, 1000, 0.0526, 0.3)
    count = compare_pettingzoo(CombatParallelEnv(combat), jax.jit(combat.step), actions)
    assert count.terminated > 200 and count.truncated > 200
    assert {Cause.ATTACKER_CRASH, Cause.DEFENDER_CRASH, Cause.TIMEOUT} <= count.causes


def test_pettingzoos_own_tests_pass(duel: Combat):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parallel_api_test(CombatParallelEnv(duel), num_cycles=3 * LENGTH)
        parallel_seed_test(lambda: CombatParallelEnv(duel), num_cycles=LENGTH)


def test_pettingzoos_render_test_passes(duel: Combat, capsys: pytest.CaptureFixture):
    if fault := rendering.fault():
        pytest.skip(fault)
    render_test(lambda render_mode: parallel_to_aec(CombatParallelEnv(duel, render_mode)))
    assert "attacker at" in capsys.readouterr().out


def test_a_picture_shows_what_moved(duel: Combat):
    if fault := rendering.fault():
        pytest.skip(fault)
    env = CombatParallelEnv(duel, "rgb_array")
    env.reset(seed=0)
    first = env.render()
    env.step(both(np.float32([1.0, 1.0, 0.0, 0.0])))
    second = env.render()
    env.close()
    assert first.shape == (540, 960, 3) and first.dtype == np.uint8 and first.std() > 5
    assert 10 < np.sum(np.any(first != second, axis=-1)) < 100_000


def test_our_own_checker_finds_no_fault():
    report = check(CombatParallelEnv(coasting(episode_steps=6)), steps=150)
    assert report.unseen == ("fights-alike, neighbours, lost-transition: there is one fight alone",)


def test_the_state_is_the_fight(duel: Combat):
    env = CombatParallelEnv(duel)
    observation, _ = env.reset(seed=3)
    env.step(both())
    state = env.state()
    assert state in env.state_space and state.shape == (32,)
    np.testing.assert_array_equal(state[:14], env.fight.qpos)
    np.testing.assert_array_equal(state[26:29], observation["attacker"][14:17])  # p_t
    np.testing.assert_allclose(state[29:], [1 / LENGTH, 0.0, 0.0])
    assert env.state_spaces["defender"] is env.state_space


def test_seeds(duel: Combat):
    env = CombatParallelEnv(duel)
    start = lambda **given: env.reset(**given)[0]["attacker"][[2, 9, 16]].tobytes()
    first, second = start(seed=1), start()
    assert [start(seed=1), start()] == [first, second]
    assert len({first, second, start(), start(seed=2), start(seed=2**80)}) == 5


def test_a_downed_drone_stays_until_the_fight_ends():
    env = CombatParallelEnv(coasting(crash_rule="out"))
    env.reset(seed=0)
    actions = {"defender": np.float32([-1.0, 0, 0, 0]), "attacker": HOLD}
    active = []
    for step in range(LENGTH):
        _, _, terminated, truncated, infos = env.step(actions)
        active.append(infos["defender"]["active"])
        over = step == LENGTH - 1
        assert env.agents == ([] if over else ["defender", "attacker"])
        assert not any(terminated.values()) and set(truncated.values()) == {over}
        assert not over or infos["defender"]["outcome"] == infos["attacker"]["outcome"] == 0
    assert active[0] and not active[-1]


def test_alone_there_is_the_attacker():
    env = CombatParallelEnv(coasting(scenario="solo"))
    observation, _ = env.reset(seed=0)
    assert env.possible_agents == env.agents == list(observation) == ["attacker"]
    assert list(env.step({"attacker": HOLD})[1]) == ["attacker"]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda env: env.step(both()), "has not begun"),
        (lambda env: env.state(), "no fight has begun"),
        (lambda env: (env.reset(), env.step({"attacker": HOLD})), "of attacker: those of defender"),
        (lambda env: (env.reset(), env.step(both(np.zeros(3)))), r"shape \(3,\), not \(4,\)"),
        (lambda env: env.observation_space("judge"), "agent judge: there are defender, attacker"),
        (lambda env: env.reset(seed=-3), "seed = -3"),
        (lambda env: CombatParallelEnv(env.combat, "film"), "render_mode = film"),
    ],
)
def test_what_cannot_be_is_one_line(duel: Combat, wrong, words: str):
    with pytest.raises(UserError, match=words) as caught:
        wrong(CombatParallelEnv(duel))
    assert "\n" not in caught.value.message
