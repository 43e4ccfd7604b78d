"""Matches: `fight` against `record` against a plain loop, and one fight cut out of a record."""

from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from policies import make_policy

from dronecombat_jax.arena.match import (
    fight,
    policy_pilot,
    policy_team,
    record,
    start_fights,
    trajectory,
)
from dronecombat_jax.combat.observe import layout_of
from dronecombat_jax.combat.sensors import see
from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.learn.rollout import policy_mean
from dronecombat_jax.types import (
    ATTACKER,
    DEFENDER,
    MLP,
    Cause,
    EnvState,
    FightRecord,
    FightResult,
    Policy,
    Scaler,
)

LEFT = 30  # control steps to the time-out of every fight but the last
KEY = jax.random.key(7)


def hover(state, observation, key):
    """Near hover, with a little noise, so that keys matter."""
    noise = 0.02 * jax.random.normal(key, (len(observation), 4))
    return noise.at[:, 0].add(0.0526)


def bounce(state, observation, key):
    """Level, with a thrust that jumps up and down."""
    side = jax.random.rademacher(key, (len(observation),), jnp.float32)
    return jnp.zeros((len(observation), 4)).at[:, 0].set(0.0526 + 0.3 * side)


@pytest.fixture(scope="module")
def start(arena: SimpleNamespace) -> EnvState:
    """Eight fights, most near an end of their own: caught, reached, crashed, crashed together,
    broken, timed out.
    """
    state = start_fights(arena.combat, jax.random.key(0), arena.size)
    qpos, qvel = np.array(state.qpos), np.array(state.qvel)
    qpos[0, :3], qpos[0, 7:10], qvel[0, 7] = (0, 5, 1), (0, 3, 1), 5.0
    qpos[1, 7:10], qvel[1, 6] = (3, 5, state.target[1, 2]), 8.0
    qpos[2, 2], qvel[2, 2] = 0.4, -3.0
    qpos[3, 9], qvel[3, 8] = 0.6, -4.0
    qpos[4, [2, 9]], qvel[4, [2, 8]] = 0.4, -3.0
    qvel[5, 3:6] = np.nan
    clock = np.full(arena.size, arena.combat.config.game.episode_steps - LEFT, np.int32)
    clock[7] -= 1
    return state.replace(qpos=jnp.array(qpos), qvel=jnp.array(qvel), clock=jnp.array(clock))


@pytest.fixture(scope="module")
def fought(arena: SimpleNamespace, start: EnvState) -> FightResult:
    # The check of key reuse is on while the program is traced.
    with jax.debug_key_reuse(True):
        return jax.jit(lambda start, key: fight(arena.combat, hover, bounce, start, key))(
            start, KEY
        )


@pytest.fixture(scope="module")
def recorded(arena: SimpleNamespace, start: EnvState) -> FightRecord:
    return jax.jit(lambda start, key: record(arena.combat, hover, bounce, start, key))(start, KEY)


@pytest.mark.long
def test_fight_ends_as_its_record_ends(fought: FightResult, recorded: FightRecord):
    jax.tree.map(np.testing.assert_array_equal, fought, recorded.result)


@pytest.mark.long
def test_every_fight_is_counted_up_to_its_own_end(
    arena: SimpleNamespace, start: EnvState, recorded: FightRecord
):
    """Against a plain loop that flies the recorded actions through the environment and stops
    nobody.
    """
    cause, steps = np.zeros(arena.size, int), np.zeros(arena.size, int)
    down, last = np.zeros((arena.size, 2), bool), np.array(start.qpos)
    state = start
    for step in range(LEFT + 1):
        np.testing.assert_array_equal(start.target, state.target)
        state, output = arena.step(state, recorded.action[step])
        on = cause == Cause.NONE
        last[on], down[on], steps[on], cause[on] = (
            state.qpos[on],
            state.down[on],
            step + 1,
            output.cause[on],
        )
        np.testing.assert_allclose(recorded.qpos[step], last, atol=1e-4)
    np.testing.assert_array_equal(recorded.result.cause, cause)
    np.testing.assert_array_equal(recorded.result.steps, steps)
    np.testing.assert_array_equal(recorded.result.down, down)


def test_the_fights_end_in_every_way(recorded: FightRecord):
    names = [Cause(int(cause)).name for cause in recorded.result.cause]
    assert names[:6] == [
        "INTERCEPT",
        "REACHED",
        "DEFENDER_CRASH",
        "ATTACKER_CRASH",
        "BOTH_CRASH",
        "DIVERGED",
    ]
    assert names[6:] == ["TIMEOUT", "TIMEOUT"]
    steps = recorded.result.steps
    assert steps[5] == 1 and list(steps[6:]) == [LEFT, LEFT + 1]
    np.testing.assert_array_equal(
        recorded.result.down[:5], [[0, 0], [0, 0], [1, 0], [0, 1], [1, 1]]
    )


def test_after_its_end_a_fight_stands_still(recorded: FightRecord):
    assert recorded.qpos.shape == (500, 8, 14) and recorded.action.shape == (500, 8, 2, 4)
    for index, steps in enumerate(recorded.result.steps):
        for path in (recorded.qpos, recorded.qvel):
            ending = np.asarray(path[int(steps) - 1 :, index])
            np.testing.assert_array_equal(ending, np.broadcast_to(ending[0], ending.shape))
    assert np.all(np.abs(recorded.action) <= 1.0)


def test_the_same_key_gives_the_same_starts(arena: SimpleNamespace):
    first, second = (start_fights(arena.combat, jax.random.key(3), 4) for _ in range(2))
    jax.tree.map(np.testing.assert_array_equal, first, second)
    other = start_fights(arena.combat, jax.random.key(4), 4)
    assert not np.any(first.qpos[:, 2] == other.qpos[:, 2])


def test_trajectory_is_cut_at_the_fights_end(
    arena: SimpleNamespace, start: EnvState, recorded: FightRecord
):
    for index in range(arena.size):
        fight = trajectory(arena.combat, recorded, index)
        steps = int(recorded.result.steps[index])
        assert fight.qpos.shape == (steps + 1, 14) and fight.qvel.shape == (steps + 1, 12)
        assert fight.action.shape == (steps + 1, 2, 4)
        np.testing.assert_allclose(fight.time, 0.02 * np.arange(steps + 1))
        np.testing.assert_array_equal(fight.qpos[0], start.qpos[index])
        np.testing.assert_array_equal(fight.qpos[1:], recorded.qpos[:steps, index])
        np.testing.assert_array_equal(fight.qvel[-1], recorded.qvel[-1, index])
        np.testing.assert_array_equal(fight.action[:-1], recorded.action[:steps, index])
        np.testing.assert_array_equal(fight.action[-1], fight.action[-2])
        np.testing.assert_array_equal(fight.target, start.target[index])
        assert fight.cause == recorded.result.cause[index] and type(fight.cause) is int
        assert fight.control_dt == 0.02


plain_pilot: Any = policy_pilot  # of policies that remember nothing


def test_policy_pilot_flies_its_roles_row():
    """A linear policy that returns the first four numbers of its scaled observation."""
    copy = jnp.eye(35, 4)
    scaler = Scaler(mean=jnp.full(35, 1.0), variance=jnp.full(35, 4.0), count=jnp.ones(()))
    policy = Policy(MLP((copy,), (jnp.zeros(4),)), jnp.array([-50.0, 0.0, 0.0, 0.0]), scaler)
    observation = jnp.arange(2 * 2 * 35, dtype=jnp.float32).reshape(2, 2, 35) / 20.0
    learn = LearnConfig()
    for role in (DEFENDER, ATTACKER):
        action = plain_pilot(learn, policy, role)(None, observation, KEY)
        expected = np.clip((observation[:, role, :4] - 1.0) / 2.0, -5, 5)
        np.testing.assert_allclose(action, expected, rtol=1e-5)
        drawn = plain_pilot(learn, policy, role, stochastic=True)(None, observation, KEY)
        # its log-std is at the lower bound
        np.testing.assert_allclose(drawn[:, 0], expected[:, 0], atol=1e-6)
        assert np.all(drawn[:, 1:] != expected[:, 1:])
        np.testing.assert_array_equal(
            drawn, plain_pilot(learn, policy, role, True)(None, observation, KEY)
        )
        raw = plain_pilot(LearnConfig(normalize_observations=False), policy, role)(
            None, observation, KEY
        )
        np.testing.assert_allclose(raw, observation[:, role, :4])


@pytest.mark.long
def test_a_policy_is_shown_what_it_saw_in_its_training(arena: SimpleNamespace, start: EnvState):
    """`engagement` in a game that shows eq. 5: its action is the network's on those 60 numbers."""
    policy = make_policy((60, 8, 4))
    learn, config = LearnConfig(), arena.combat.config
    (pilot,) = policy_team(config, learn, policy, ATTACKER, False, "engagement")
    assert callable(pilot)
    layout = layout_of("engagement", config.game)
    seen = jax.vmap(lambda state: see(config, layout, state))(start)
    given = jax.vmap(arena.combat.observe)(start)
    wanted = policy_mean(learn, policy, seen[:, ATTACKER])
    np.testing.assert_allclose(pilot(start, given, KEY), wanted, atol=1e-6)
