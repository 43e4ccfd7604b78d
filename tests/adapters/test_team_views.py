"""Views of fights between teams: an agent for each drone, or one line that says why not."""

import jax
import numpy as np
import pytest
from pettingzoo.test import parallel_api_test
from toy import UNOPTIMISED, Coasting

from dronecombat_jax.adapters import check
from dronecombat_jax.adapters.brax_env import CombatEnv
from dronecombat_jax.adapters.gymnasium_env import CombatVectorEnv
from dronecombat_jax.adapters.jaxmarl_env import CombatMultiAgentEnv
from dronecombat_jax.adapters.pettingzoo_env import CombatParallelEnv
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.errors import UserError

NAMES = ["defender1", "defender2", "attacker"]
LENGTH = 15


@pytest.fixture(scope="module")
def combat() -> Coasting:
    return Coasting(Config(game=GameConfig(defenders=2, crash_rule="out", episode_steps=LENGTH)))


def test_pettingzoo_has_an_agent_for_each_drone_and_steps_as_the_core(combat: Coasting):
    env = CombatParallelEnv(combat)
    assert env.possible_agents == NAMES and env.state_space.shape == (14 * 3 + 4,)
    parallel_api_test(env, num_cycles=2 * LENGTH)
    step = jax.jit(combat.step, compiler_options=UNOPTIMISED)
    seen, _ = env.reset(seed=1)
    random, fight = np.random.default_rng(0), env.fight
    for _ in range(LENGTH):
        action = random.uniform(-1, 1, (3, 4)).astype(np.float32)
        seen, reward, ended, late, infos = env.step(dict(zip(NAMES, action, strict=True)))
        fight, output = step(fight, action)
        for drone, name in enumerate(NAMES):
            np.testing.assert_allclose(seen[name], output.observation[drone], atol=1e-5)
            assert reward[name] == pytest.approx(float(output.reward[drone]), abs=1e-5)
            assert infos[name]["active"] == bool(output.active[drone])
        assert env.state()[-3:].tolist() == fight.down.tolist()
        if not env.agents:
            assert set(ended.values()) | set(late.values()) == {True, False}
            return
    raise AssertionError("the fight did not end")


def test_jaxmarl_has_an_agent_for_each_drone(combat: Coasting):
    env = CombatMultiAgentEnv(combat)
    assert env.agents == NAMES
    assert env.agent_classes == {"defender": NAMES[:2], "attacker": NAMES[2:]}
    _, state = env.reset(jax.random.key(0))
    action = np.random.default_rng(0).uniform(-1, 1, (3, 4)).astype(np.float32)
    seen, after, reward, _, _ = env.step_env(
        jax.random.key(1), state, dict(zip(NAMES, action, strict=True))
    )
    wanted, output = combat.step(state, action)
    np.testing.assert_allclose(after.qpos, wanted.qpos, rtol=1e-6)
    for drone, name in enumerate(NAMES):
        np.testing.assert_allclose(seen[name], output.observation[drone], rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(reward[name], output.reward[drone], rtol=1e-5)


def test_the_checker_finds_nothing(combat: Coasting):
    check(CombatParallelEnv(combat), steps=100)
    assert check(CombatMultiAgentEnv(combat), steps=150).unseen == ()


def test_a_view_of_one_drone_a_side_says_so(combat: Coasting):
    for view in (CombatEnv, CombatVectorEnv):
        with pytest.raises(UserError, match="made for one drone a side, not 2 against 1"):
            view(combat, 0)
