"""What a view of both sides must show, by the core alone: the core's step from the state before it."""

import jax
import numpy as np
from side_views import Count, close

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.types import SIDES


def pairs(steps: int, size: int, lift: float = 0.5, spread: float = 1.0) -> np.ndarray:
    """Actions [T, N, A, 4]: a third of the fights wander until they crash, a third coast until time
    runs out, in a third the attacker alone wanders.
    """
    random = np.random.default_rng(3)
    drawn = random.normal(scale=spread, size=(steps, size, 2, 4)).astype(np.float32)
    still = np.float32([lift, 0.0, 0.0, 0.0])
    drawn[:, ::3], drawn[:, 1::3, 0] = still, still
    return drawn


def by_agent(rows) -> dict:
    return {name: rows[..., index, :] for index, name in enumerate(SIDES)}


def compare_jaxmarl(env, combat: Combat, actions: np.ndarray, options: dict | None = None) -> Count:
    """Fly N of a JaxMARL environment and compare each step with the core's."""
    compiled = lambda function: jax.jit(jax.vmap(function), compiler_options=options)
    step, core, observe = compiled(env.step), compiled(combat.step), compiled(combat.observe)
    size, count = actions.shape[1], Count()
    key = jax.random.key(4)
    seen, state = compiled(env.reset)(jax.random.split(key, size))
    for number, action in enumerate(actions):
        keys = jax.random.split(jax.random.fold_in(key, number), size)
        after, output = core(state, action)
        seen, state, rewards, dones, infos = step(keys, state, by_agent(action))
        over = np.asarray(output.terminated | output.truncated)
        now = observe(state)
        for index, name in enumerate(SIDES):
            close(infos["final_observation"][name], output.observation[:, index])
            close(seen[name][~over], output.observation[~over, index])
            close(seen[name], now[:, index])
            close(rewards[name], output.reward[:, index])
            np.testing.assert_array_equal(dones[name], over)
            np.testing.assert_array_equal(infos["truncated"][name], output.truncated)
        np.testing.assert_array_equal(dones["__all__"], over)
        np.testing.assert_array_equal(infos["cause"], output.cause)
        np.testing.assert_array_equal(state.clock, np.where(over, 0, after.clock))
        close(np.asarray(state.qpos)[~over], np.asarray(after.qpos)[~over])
        count = count.add(output, np.ones(size, bool))
    return count


def compare_pettingzoo(env, core, actions: np.ndarray) -> Count:
    """Fly a PettingZoo environment, fight after fight, and compare each step with the jitted `core`
    step of one fight.
    """
    count, alone = Count(), np.ones((), bool)
    env.reset(seed=5)
    for index in range(actions.shape[1]):
        for action in actions[:, index]:
            before = env.fight
            _, output = core(before, action)
            seen, reward, terminated, truncated, infos = env.step(by_agent(action))
            for side, name in enumerate(SIDES):
                close(seen[name], output.observation[side])
                assert reward[name] == pytest_close(output.reward[side])
                assert terminated[name] is bool(output.terminated)
                assert truncated[name] is bool(output.truncated)
                assert infos[name]["active"] is bool(output.active[side])
            count = count.add(jax.tree.map(np.asarray, output), alone)
            if not env.agents:
                assert infos[SIDES[0]]["cause"] == int(output.cause)
                break
        env.reset()
    return count


def pytest_close(value):
    import pytest

    return pytest.approx(float(value), rel=1e-5, abs=1e-5)
