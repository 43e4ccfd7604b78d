"""The environment: its contract, its start, and one broken fight among sound ones. How fights end:
`test_ends`.
"""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.errors import KeyReuseError

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause, EnvState

NEVER = np.zeros(1000, bool)  # alone


def test_mjx_is_loaded_by_the_first_flight_and_bound_to_no_trace(arena: SimpleNamespace):
    """Starts and observations do without.

    What is made inside a trace must hold constants: an array of that trace has no value later.
    """
    combat = Combat(Config(), arena.combat.scene)
    state = jax.eval_shape(combat.reset, jax.random.key(0))
    jax.eval_shape(combat.observe, state)
    assert "_fly" not in vars(combat)
    jax.eval_shape(combat.step, state, jnp.zeros((2, 4)))
    fly = jax.jit(combat._fly, compiler_options={"xla_backend_optimization_level": 0})
    level = jnp.tile(jnp.asarray([0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0]), 2)
    _, qvel = fly(level, jnp.zeros(12), -jnp.ones((2, 4)))
    # no thrust: it falls
    np.testing.assert_allclose(qvel[2], -9.81 * combat.config.control_dt, rtol=1e-4)


@pytest.mark.parametrize(
    "game",
    [
        GameConfig(),
        GameConfig(crash_rule="out", timeout_rule="defender", observation="ego", spawn="uniform"),
        GameConfig(crash_rule="grounded"),
        GameConfig(scenario="solo", swept_events=False),
    ],
    ids=["default", "out, ego, uniform", "grounded", "solo"],
)
def test_shapes_and_types_are_stable_under_every_switch(arena: SimpleNamespace, game: GameConfig):
    combat = Combat(Config(game=game), arena.combat.scene)
    state = jax.eval_shape(combat.reset, jax.random.key(0))
    after, output = jax.eval_shape(combat.step, state, jnp.zeros((2, 4)))
    described = lambda tree: jax.tree.map(lambda leaf: (leaf.shape, leaf.dtype.name), tree)
    assert described(after) == described(state)
    assert described(state) == EnvState(
        qpos=((14,), "float32"), qvel=((12,), "float32"), target=((3,), "float32"), clock=((), "int32"),
        down=((2,), "bool"),
    )  # fmt: skip
    # A weak type in what is carried compiles every program twice.
    assert not [leaf for leaf in jax.tree.leaves((state, after, output)) if leaf.weak_type]
    assert described(output.observation) == ((2, 35), "float32")
    assert described(jax.eval_shape(combat.observe, state)) == ((2, 35), "float32")
    assert {described(leaf) for leaf in (output.reward, *output.reward_terms)} == {
        ((2,), "float32")
    }
    assert described((output.cause, output.terminated, output.truncated)) == (
        ((), "int32"), ((), "bool"), ((), "bool"),
    )  # fmt: skip


def test_contract_over_many_random_steps(arena: SimpleNamespace, fresh: EnvState):
    random = np.random.default_rng(0)
    state = fresh.replace(clock=fresh.clock + 470)
    observe, ended = jax.jit(jax.vmap(arena.combat.observe)), set()
    for _ in range(40):
        before = state
        state, output = arena.step(state, random.normal(size=(arena.size, 2, 4)).astype(np.float32))
        assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves((state, output)))
        assert not np.any(output.terminated & output.truncated)
        np.testing.assert_array_equal(
            output.terminated | output.truncated, output.cause != Cause.NONE
        )
        np.testing.assert_array_equal(output.truncated, output.cause == Cause.TIMEOUT)
        # before any reset
        np.testing.assert_allclose(output.observation, observe(state), rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(
            output.reward, np.sum(np.array(output.reward_terms), axis=0), rtol=1e-5, atol=1e-5
        )
        np.testing.assert_array_equal(state.clock, before.clock + 1)
        ended |= {int(cause) for cause in output.cause}
    assert {Cause.NONE, Cause.TIMEOUT} < ended
    assert arena.traces == [(2, 4)]  # stepped by other tests as well, and traced once


def test_deterministic(arena: SimpleNamespace, fresh: EnvState):
    same = arena.reset(jax.random.split(jax.random.key(0), arena.size))
    action = np.random.default_rng(1).uniform(-1, 1, (arena.size, 2, 4)).astype(np.float32)
    first, second = arena.step(fresh, action), arena.step(same, action)
    jax.tree.map(np.testing.assert_array_equal, first, second)


def test_a_fight_does_not_depend_on_its_neighbours(arena: SimpleNamespace, fresh: EnvState):
    action = np.random.default_rng(1).uniform(-1, 1, (arena.size, 2, 4)).astype(np.float32)
    backwards = lambda tree: jax.tree.map(lambda leaf: leaf[::-1], tree)
    jax.tree.map(
        np.testing.assert_array_equal,
        arena.step(fresh, action),
        backwards(arena.step(backwards(fresh), action[::-1])),
    )


def test_what_a_fight_carries_is_small(fresh: EnvState):
    assert sum(leaf.nbytes for leaf in jax.tree.leaves(fresh)) / len(fresh.clock) < 200


def test_key_is_used_once(arena: SimpleNamespace):
    combat = arena.combat
    with jax.debug_key_reuse(True):
        jax.jit(lambda key: combat.reset(key))(jax.random.key(0))
        with pytest.raises(KeyReuseError):  # so that the check can fail
            jax.jit(lambda key: (combat.reset(key), combat.start_numbers(key, (3,))))(
                jax.random.key(0)
            )


@pytest.mark.parametrize(
    ("leaf", "column", "value"),
    [
        ("qvel", 1, np.nan), ("qvel", 1, 1e20), ("qvel", 9, np.nan), ("qvel", slice(3, 6), 1e20), ("qvel", 2, -np.inf),
        ("qpos", 2, np.nan), ("qpos", 8, 1e20), ("qpos", slice(10, 14), np.nan),
    ],
)  # fmt: skip
def test_a_diverged_fight_ends_alone(arena: SimpleNamespace, fresh: EnvState, leaf, column, value):
    action = np.random.default_rng(1).uniform(-1, 1, (8, 2, 4)).astype(np.float32)
    sound, sound_output = arena.step(fresh, action)
    broken = fresh.replace(**{leaf: getattr(fresh, leaf).at[3, column].set(value)})
    after, output = arena.step(broken, action)
    assert_others_have_the_same_bits((after, output), (sound, sound_output))
    assert output.cause[3] == Cause.DIVERGED
    assert output.terminated[3] and not output.truncated[3]
    assert not any(np.any(term[3]) for term in (output.reward, *output.reward_terms))
    assert not np.any(after.down[3])
    for part in jax.tree.leaves((after, output)):
        assert np.all(np.abs(part[3]) < 1e4)  # also false for NaN: nothing spoils a running mean


BOTH = slice(None)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    ("agent", "column", "cause"),
    [
        (DEFENDER, 2, Cause.DEFENDER_INVALID),
        (DEFENDER, BOTH, Cause.DEFENDER_INVALID),
        (ATTACKER, 0, Cause.ATTACKER_INVALID),
        (BOTH, 3, Cause.BOTH_INVALID),
    ],
)
def test_an_action_that_is_not_finite_loses_its_fight_alone(
    arena: SimpleNamespace, fresh: EnvState, agent, column, cause, value
):
    action = np.random.default_rng(1).uniform(-1, 1, (8, 2, 4)).astype(np.float32)
    sound = arena.step(fresh, action)
    bad = action.copy()
    bad[3, agent, column] = value
    after, output = arena.step(fresh, bad)
    assert_others_have_the_same_bits((after, output), sound)
    assert output.cause[3] == cause and output.terminated[3] and not output.truncated[3]
    assert not any(np.any(term[3]) for term in (output.reward, *output.reward_terms))
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves((after, output)))
    bad[3, agent, column] = 0.0  # what is flown in its place
    flown, _ = arena.step(fresh, bad)
    np.testing.assert_array_equal(after.qpos, flown.qpos)


def test_an_invalid_action_comes_before_what_happens_in_flight_and_after_a_diverged_state(
    arena: SimpleNamespace, fresh
):
    action = np.zeros((8, 2, 4), np.float32)
    action[3, DEFENDER] = np.nan
    caught = fresh.replace(
        qpos=fresh.qpos.at[3, 7:9].set(fresh.qpos[3, :2]).at[3, 9].set(fresh.qpos[3, 2])
    )
    assert arena.step(caught, action)[1].cause[3] == Cause.DEFENDER_INVALID
    assert arena.step(caught, np.zeros_like(action))[1].cause[3] == Cause.INTERCEPT
    broken = fresh.replace(qvel=fresh.qvel.at[3, 0].set(np.nan))
    assert arena.step(broken, action)[1].cause[3] == Cause.DIVERGED


def test_a_drone_that_is_down_gives_no_action(arena: SimpleNamespace, fresh: EnvState):
    """Nor does the absent defender of `solo`, whose flag is the same."""
    down = fresh.replace(down=fresh.down.at[3, DEFENDER].set(True))
    action = np.full((8, 2, 4), 0.1, np.float32)
    bad = action.copy()
    bad[3, DEFENDER] = np.nan
    assert_same(arena.step(down, bad), arena.step(down, action))


def test_a_huge_action_is_clipped(arena: SimpleNamespace, fresh: EnvState):
    action = np.random.default_rng(1).uniform(-1, 1, (8, 2, 4)).astype(np.float32)
    huge, full = action.copy(), action.copy()
    huge[3], full[3] = 1e30, 1.0
    huge[3, ATTACKER, 1], full[3, ATTACKER, 1] = -1e30, -1.0
    assert_same(arena.step(fresh, huge), arena.step(fresh, full))


def assert_same(ours, theirs) -> None:
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(a, b, strict=True), ours, theirs)


def assert_others_have_the_same_bits(ours, theirs) -> None:
    """All fights but that of environment 3."""
    others = np.arange(8) != 3
    for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        assert np.asarray(a)[others].tobytes() == np.asarray(b)[others].tobytes()
