"""How fights end and go on, by real physics, through the environment's `step`."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.types import Cause, EnvState

HOVER = (2.0 / 1.9 - 1.0, 0.0, 0.0, 0.0)
DROP = (-1.0, 0.0, 0.0, 0.0)


def names(causes) -> list[str]:
    return [Cause(int(cause)).name for cause in causes]


def held(size: int, defender=HOVER, attacker=HOVER) -> np.ndarray:
    return np.tile(np.array([defender, attacker], np.float32), (size, 1, 1))


def place(state: EnvState, fight: int, **changes) -> EnvState:
    """The state with parts of one fight replaced, e.g. `attacker=(x, y, z)`."""
    columns = {
        "defender": ("qpos", 0),
        "attacker": ("qpos", 7),
        "defender_v": ("qvel", 0),
        "attacker_v": ("qvel", 6),
    }
    for name, value in changes.items():
        if name in columns:
            leaf, first = columns[name]
            column = slice(first, first + len(value))
            state = state.replace(
                **{leaf: getattr(state, leaf).at[fight, column].set(jnp.array(value, jnp.float32))}
            )
        else:
            state = state.replace(**{name: getattr(state, name).at[fight].set(value)})
    return state


def test_every_end_in_flight(arena: SimpleNamespace, fresh: EnvState):
    """Eight fights, each one step before its end."""
    state = fresh
    state = place(state, 0, attacker=(0, 4.4, 1), defender=(0, 5, 1), attacker_v=(0, 8, 0))
    state = place(state, 1, attacker=(5, 4.45, 1), target=(5, 5, 1), attacker_v=(0, 5, 0))
    state = place(state, 2, defender=(0, 5, 0.21), defender_v=(0, 0, -2))
    state = place(state, 3, attacker=(0, 0, 0.21), attacker_v=(0, 0, -2))
    state = place(
        state,
        4,
        attacker=(0, 0, 0.21),
        attacker_v=(0, 0, -2),
        defender=(0, 5, 0.21),
        defender_v=(0, 0, -2),
    )
    state = place(state, 5, clock=499)
    state = place(state, 6, clock=498)
    # tunnels: 4 m in a step
    state = place(state, 7, attacker=(0, 3, 1), defender=(0, 5, 1), attacker_v=(0, 200, 0))
    after, output = arena.step(state, held(8))
    expected = [
        "INTERCEPT",
        "REACHED",
        "DEFENDER_CRASH",
        "ATTACKER_CRASH",
        "BOTH_CRASH",
        "TIMEOUT",
        "NONE",
        "INTERCEPT",
    ]
    assert names(output.cause) == expected
    np.testing.assert_array_equal(output.terminated, [1, 1, 1, 1, 1, 0, 0, 1])
    np.testing.assert_array_equal(output.truncated, [0, 0, 0, 0, 0, 1, 0, 0])
    np.testing.assert_array_equal(after.down[2:5], [[1, 0], [0, 1], [1, 1]])
    events = output.reward_terms.win + output.reward_terms.lose + output.reward_terms.crash
    win = [300, -300]
    prizes = [win, [-300, 300], [-10, 300], [300, -10], [-10, -10], [0, 0], [0, 0], win]
    np.testing.assert_array_equal(events, prizes)


@pytest.mark.long
def test_a_drone_that_fell_lies_where_it_fell(arena: SimpleNamespace, fresh: EnvState):
    """And pays for the speed with which it came down; the one that hovers goes on."""
    state, fell = fresh, np.zeros(8, bool)
    for _ in range(40):
        before = state
        state, output = arena.step(state, held(8, defender=DROP))
        np.testing.assert_array_equal(state.qpos[fell, :7], before.qpos[fell, :7])
        np.testing.assert_array_equal(state.qvel[state.down[:, 0], :6], 0)
        just = np.asarray(state.down[:, 0]) & ~fell
        assert np.all(output.reward_terms.linear_velocity[just, 0] < -0.02 * 0.05 * 2)
        np.testing.assert_array_equal(output.reward_terms.crash[:, 0], np.where(just, -10, 0))
        fell |= just
    assert np.all(fell)
    np.testing.assert_allclose(state.qpos[:, 7:], fresh.qpos[:, 7:], atol=2e-3)


def test_an_absent_defender_stands_where_it_starts(arena: SimpleNamespace):
    combat = arena.combat
    numbers = combat.start_numbers(jax.random.key(1), (8,))
    solo = Combat(Config(game=GameConfig(scenario="solo")), combat.scene)
    start = jax.vmap(solo.spawn)(numbers)
    np.testing.assert_array_equal(start.down, [[True, False]] * 8)
    present = jax.vmap(combat.spawn)(numbers)  # all else is as it would be
    jax.tree.map(np.testing.assert_array_equal, start.replace(down=present.down), present)
    state = place(start, 0, attacker=(0, 5, 1))  # inside the defender
    for _ in range(5):
        state, output = arena.step(state, held(8, defender=(1, 1, 1, 1)))
        np.testing.assert_array_equal(output.cause, Cause.NONE)
        np.testing.assert_array_equal(output.reward[:, 0], 0)
    np.testing.assert_array_equal(state.qpos[:, :7], start.qpos[:, :7])


def test_actions_are_clipped(arena: SimpleNamespace, fresh: EnvState):
    wild = held(8, (1e30, 7, -3e38, 0.5), (-9, -1.0001, 1e9, 3e38))
    jax.tree.map(
        np.testing.assert_array_equal,
        arena.step(fresh, wild),
        arena.step(fresh, held(8, (1, 1, -1, 0.5), (-1, -1, 1, 1))),
    )


@pytest.mark.long
def test_a_defender_that_is_out_leaves_the_attacker_to_finish(
    arena: SimpleNamespace, fresh: EnvState
):
    """Crash rule `out`, time-out for the defender: the attacker flies on, and running out of time
    decides.
    """
    config = arena.combat.config
    config = replace(config, game=replace(config.game, crash_rule="out", timeout_rule="defender"))
    step = jax.jit(jax.vmap(Combat(config, arena.combat.scene).step))
    state = place(fresh, 0, defender=(0, 5, 0.21), defender_v=(0, 0, -2))
    state = place(state, 1, defender=(0, 5, 0.21), defender_v=(0, 0, -2), attacker=(5, 4.4, 1), target=(5, 5, 1),
                  attacker_v=(0, 3, 0))  # fmt: skip
    state = place(state, 2, defender=(0, 5, 0.21), defender_v=(0, 0, -2), clock=498)
    state = place(state, 3, attacker=(0, 0, 0.21), attacker_v=(0, 0, -2))
    state, output = step(state, held(8))
    assert names(output.cause[:4]) == ["NONE", "NONE", "NONE", "ATTACKER_CRASH"]
    state, output = step(state, held(8))
    assert names(output.cause[:3]) == ["NONE", "REACHED", "TIMEOUT"]
    assert output.terminated[2] and not output.truncated[2]
    np.testing.assert_array_equal(output.reward_terms.timeout[2], [300, -300])
    np.testing.assert_array_equal(
        output.reward[:3, 0] - output.reward_terms.timeout[:3, 0], [0, -300, 0]
    )
