"""Views of fights between teams: an agent for each drone, or one for all drones of a side."""

import jax
import numpy as np
import pytest
from pettingzoo.test import parallel_api_test
from toy import UNOPTIMISED, Coasting

from dronecombat_jax.adapters import check
from dronecombat_jax.adapters.brax_env import CombatEnv, wrap
from dronecombat_jax.adapters.gymnasium_env import CombatVectorEnv
from dronecombat_jax.adapters.jaxmarl_env import CombatMultiAgentEnv
from dronecombat_jax.adapters.opponents import pilots_of
from dronecombat_jax.adapters.pettingzoo_env import CombatParallelEnv
from dronecombat_jax.combat.scripted import build_pilot
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.config.sides import team
from dronecombat_jax.types import ATTACKER, DEFENDER

NAMES = ["defender1", "defender2", "attacker"]
LENGTH = 15


def crew(count):
    """Opponents: `count` drones, each with an action of its own fight and its own number, [E, M, 4]."""
    return lambda fights, seen, key: (
        0.1 * fights.qpos[:, None, :4] * np.arange(1, count + 1)[:, None]
    )


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


@pytest.mark.long
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


@pytest.mark.long
def test_the_checker_finds_nothing(combat: Coasting):
    check(CombatParallelEnv(combat), steps=100)
    assert check(CombatMultiAgentEnv(combat), steps=150).unseen == ()


@pytest.mark.parametrize("role", [DEFENDER, ATTACKER])
@pytest.mark.long
def test_a_learner_flies_all_drones_of_its_side(combat: Coasting, role: int):
    """Observations and actions end to end in the drones' order, the team's mean reward."""
    own, others = team(combat.sides, role), team(combat.sides, 1 - role)
    count, others_count = own.stop - own.start, others.stop - others.start
    against = crew(others_count)
    env = CombatVectorEnv(combat, role, against, 3)
    single = CombatEnv(combat, role, against)
    assert env.single_observation_space.shape == (51 * count,)
    assert env.single_action_space.shape == (4 * count,)
    assert (single.observation_size, single.action_size) == (51 * count, 4 * count)
    start, _ = env.reset(seed=1)
    fights = env.bout.fight
    action = np.random.default_rng(0).uniform(-1, 1, (3, 4 * count)).astype(np.float32)
    every = np.zeros((3, 3, 4), np.float32)
    every[:, own] = action.reshape(3, count, 4)
    every[:, others] = against(fights, None, None)
    _, output = jax.jit(jax.vmap(combat.step), compiler_options=UNOPTIMISED)(fights, every)
    following, reward, *_ = env.step(action)
    rows = lambda seen: np.asarray(seen)[:, own].reshape(len(seen), -1)
    np.testing.assert_allclose(start, rows(jax.vmap(combat.observe)(fights)), atol=1e-5)
    np.testing.assert_allclose(following, rows(output.observation), atol=1e-5)
    np.testing.assert_allclose(reward, np.mean(output.reward[:, own], axis=1), atol=1e-5)

    state = single.reset(jax.random.key(0))
    other = np.asarray(
        against(jax.tree.map(lambda leaf: leaf[None], state.pipeline_state), None, None)
    )[0]
    both = np.zeros((3, 4), np.float32)
    both[own], both[others] = action[0].reshape(count, 4), other
    _, output = combat.step(state.pipeline_state, both)
    after = single.step(state, action[0])
    np.testing.assert_allclose(np.asarray(after.obs), rows(output.observation[None])[0], atol=1e-5)
    assert after.reward == pytest.approx(float(np.mean(output.reward[own])), abs=1e-5)


@pytest.mark.long
def test_named_opponents_fly_whole_teams(combat: Coasting):
    """Each drone of a scripted team flies from its own place."""
    (pilot,) = pilots_of(combat, ATTACKER, "scripted:proportional_navigation")
    fights = jax.vmap(combat.reset)(jax.random.split(jax.random.key(0), 4))
    answer = pilot(fights, jax.vmap(combat.observe)(fights), jax.random.key(1))
    assert answer.shape == (4, 2, 4)
    for drone in (0, 1):
        alone = build_pilot("proportional_navigation", combat.config, combat.scene, DEFENDER, drone)
        seen = jax.vmap(combat.observe)(fights)
        np.testing.assert_allclose(answer[:, drone], alone(fights, seen, jax.random.key(1)))
    assert not np.allclose(answer[:, 0], answer[:, 1])


@pytest.mark.slow
def test_the_checker_finds_nothing_in_a_view_of_a_team(combat: Coasting):
    check(CombatVectorEnv(combat, DEFENDER, "scripted:dash", 4), steps=100)
    check(wrap(CombatEnv(combat, DEFENDER, crew(1)), LENGTH), steps=100)
