"""The view in JaxMARL's shape: each step is the core's own, and what JaxMARL overwrites is in infos."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from both_views import by_agent, compare_jaxmarl, pairs
from brax_views import LENGTH
from toy import UNOPTIMISED, Coasting

from dronecombat_jax.adapters import check
from dronecombat_jax.adapters.jaxmarl_env import CombatMultiAgentEnv
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.types import Cause

SIZE = 9


def coasting(**game) -> Combat:
    return Coasting(Config(game=GameConfig(**{"episode_steps": LENGTH} | game)))


@pytest.fixture(scope="module")
def duel() -> Combat:
    return coasting()


@pytest.mark.long
def test_each_step_is_the_cores(duel: Combat):
    env = CombatMultiAgentEnv(duel)
    count = compare_jaxmarl(env, duel, pairs(3 * LENGTH, SIZE), UNOPTIMISED)
    assert count.terminated > 5 and count.truncated > 5


@pytest.mark.slow
def test_each_step_of_1000_fights_is_the_cores():
    combat = Combat(Config(game=GameConfig(episode_steps=40, spawn="uniform")))
    count = compare_jaxmarl(CombatMultiAgentEnv(combat), combat, pairs(90, 1000, 0.0526, 0.3))
    assert count.terminated > 500 and count.truncated > 500
    assert {Cause.ATTACKER_CRASH, Cause.DEFENDER_CRASH, Cause.TIMEOUT} <= count.causes


@pytest.mark.long
def test_our_own_checker_finds_no_fault(duel: Combat):
    assert check(CombatMultiAgentEnv(duel), steps=150).unseen == ()


def test_without_infos_the_final_observation_is_missed(duel: Combat):
    from dronecombat_jax.adapters import examine

    report = examine(CombatMultiAgentEnv(duel, end_infos=False), steps=100)
    assert "final-observation" in {fault.rule for fault in report.faults}


def test_a_given_state_follows_an_end(duel: Combat):
    env = CombatMultiAgentEnv(duel)
    _, first = env.reset(jax.random.key(1))
    _, given = env.reset(jax.random.key(2))
    last = first.replace(clock=jnp.int32(LENGTH - 1))
    step = jax.jit(env.step, compiler_options=UNOPTIMISED)
    actions = by_agent(np.tile(np.float32([0.5, 0, 0, 0]), (2, 1)))
    seen, state, _, dones, infos = step(jax.random.key(3), last, actions, given)
    assert bool(dones["__all__"]) and bool(infos["truncated"]["attacker"])
    jax.tree.map(np.testing.assert_array_equal, state, given)
    np.testing.assert_array_equal(seen["attacker"], env.get_obs(given)["attacker"])
    seen, state, _, dones, _ = step(jax.random.key(3), first, actions, given)
    assert not bool(dones["__all__"]) and int(state.clock) == 1


def test_its_shape_is_jaxmarls(duel: Combat):
    env = CombatMultiAgentEnv(duel)
    assert env.agents == ["defender", "attacker"] and env.num_agents == 2
    assert env.agent_classes == {"defender": ["defender"], "attacker": ["attacker"]}
    assert env.observation_space("defender").shape == (35,)
    space = env.action_space("attacker")
    action = space.sample(jax.random.key(0))
    assert action.shape == (4,) and bool(space.contains(action))
    assert not bool(space.contains(action + 3.0))
    _, state = env.reset(jax.random.key(0))
    assert env.get_avail_actions(state)["attacker"].tolist() == [True] * 4
    assert CombatMultiAgentEnv(coasting(scenario="solo")).agents == ["attacker"]
    with pytest.raises(UserError, match="agent judge: there are defender, attacker"):
        env.action_space("judge")


def test_jaxmarl_takes_it(duel: Combat):
    pytest.importorskip("jaxmarl")
    from jaxmarl.environments.multi_agent_env import (  # pyright: ignore[reportMissingImports]
        MultiAgentEnv,
    )
    from jaxmarl.wrappers.baselines import LogWrapper  # pyright: ignore[reportMissingImports]

    env = CombatMultiAgentEnv(duel, end_infos=False)
    assert isinstance(env, MultiAgentEnv)
    logged = LogWrapper(env)
    keys = jax.random.split(jax.random.key(0), SIZE)
    _, state = jax.vmap(logged.reset)(keys)
    step = jax.jit(jax.vmap(logged.step), compiler_options=UNOPTIMISED)
    action = by_agent(np.tile(np.float32([0.5, 0, 0, 0]), (SIZE, 2, 1)))
    ends = []
    for _ in range(LENGTH):
        _, state, _, dones, infos = step(keys, state, action)
        ends.append((dones["__all__"], infos["returned_episode_lengths"]))
    assert np.all(ends[-1][0]) and not np.any(ends[-2][0])
    np.testing.assert_array_equal(ends[-1][1], LENGTH)
