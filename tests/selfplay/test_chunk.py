"""The training program at toy size: one compilation, one meaning for every way of cutting the same
run.

The slow test does it with MJX and full optimisation.
"""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy import CHUNK, CONFIG, agent, assert_same_bits, build, differs

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.fields import Config, LearnConfig
from dronecombat_jax.selfplay.chunk import (
    begin_chunk,
    build_advance,
    init_state,
    reset_fights,
    waits,
)
from dronecombat_jax.types import ATTACKER, DEFENDER, TrainState

TWO_SEEDS = replace(CONFIG, train=replace(CONFIG.train, seed=3, num_seeds=2))


@pytest.fixture(scope="module")
def single() -> SimpleNamespace:
    """Seed 4, one iteration a call, and the states after 0 to 4 iterations."""
    program = build(CONFIG, 1)
    states, reports = [program.start], []
    for _ in range(2 * CHUNK):
        state, report = program.run(states[-1])
        states.append(state)
        reports.append(report)
    return SimpleNamespace(**vars(program), states=states, reports=reports)


def numpy_copy(state: TrainState) -> TrainState:
    return jax.tree.map(np.array, state)


@pytest.mark.long
def test_traced_once_for_a_whole_run(single):
    assert len(single.traces) == 1
    assert [int(state.iteration[0]) for state in single.states] == [0, 1, 2, 3, 4]


@pytest.mark.long
def test_the_state_keeps_its_types_and_none_is_weak(single):
    before = jax.eval_shape(lambda: init_state(single.combat))
    after, _ = jax.eval_shape(single.advance, before)
    assert jax.tree.structure(before) == jax.tree.structure(after)
    for x, y in zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True):
        assert (x.shape, x.dtype, x.weak_type) == (y.shape, y.dtype, False) and not y.weak_type
    assert {leaf.dtype.name for leaf in jax.tree.leaves(after)} == {
        "float32",
        "int32",
        "uint32",
        "bool",
    }


@pytest.mark.long
def test_the_same_run_in_other_calls_beside_another_seed_and_through_numpy(single):
    """Two calls of two iterations with seeds 3 and 4 give seed 4 the bits of four calls of one,
    alone.
    """
    double = build(TWO_SEEDS, 2)
    state, _ = double.run(double.start)
    assert_same_bits(jax.tree.map(lambda leaf: leaf[1:], state), single.states[2])
    state, report = double.run(numpy_copy(state))
    assert_same_bits(jax.tree.map(lambda leaf: leaf[1:], state), single.states[4])
    assert_same_bits(jax.tree.map(lambda leaf: leaf[1:, 1:], report), single.reports[3])
    assert state.seed.tolist() == [3, 4]
    weights = state.learners.parameters.policy.weights[0]
    assert np.all(weights[0] != weights[1])  # the seeds are different runs


@pytest.mark.slow
def test_a_seed_beside_another_has_the_bits_it_has_alone_as_a_user_runs_it():
    """With MJX, full optimisation and the paper's networks."""

    def fly(config: Config, iterations: int) -> TrainState:
        combat = Combat(config)
        program = jax.jit(build_advance(combat, iterations))
        state = jax.jit(lambda: init_state(combat))()
        for _ in range(4 // iterations):
            state, _ = program(state)
        return state

    alone, beside = (
        replace(config, learn=LearnConfig(), train=replace(config.train, num_envs=40))
        for config in (CONFIG, TWO_SEEDS)
    )
    assert_same_bits(jax.tree.map(lambda leaf: leaf[1:], fly(beside, 2)), fly(alone, 1))


def test_a_restart_from_numpy_is_the_run_that_never_stopped(single):
    state, _ = single.run(numpy_copy(single.states[1]))
    assert_same_bits(state, single.states[2])
    assert len(single.traces) == 1


def test_every_leaf_matters_to_the_run(single):
    """A checkpoint that lost a leaf would be noticed: with each one changed in turn the run or its
    record is another.
    """
    start = numpy_copy(single.states[3])
    _, expected = single.run(start)
    leaves, structure = jax.tree.flatten(start)
    paths = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(start)]
    ignored = []
    for i, path in enumerate(paths):
        changed = [leaf.copy() for leaf in leaves]
        changed[i] = (
            ~changed[i]
            if changed[i].dtype == bool
            else changed[i] + np.asarray(1, changed[i].dtype)
        )
        after, report = single.run(jax.tree.unflatten(structure, changed))
        others = [x for j, x in enumerate(jax.tree.leaves(after)) if j != i]
        whole = [x for j, x in enumerate(jax.tree.leaves(single.states[4])) if j != i]
        if not differs((others, report), (whole, expected)):
            ignored.append(path)
    assert ignored == []


@pytest.fixture
def only_fights():
    """The fights in which an iteration flies, without flying them."""

    def flown_in(config: Config, state: TrainState, iteration: int):
        one = jax.tree.map(lambda leaf: jnp.asarray(leaf)[0], state).replace(
            iteration=jnp.int32(iteration)
        )
        return jax.jit(lambda state: begin_chunk(Combat(config), state).env)(one)

    return flown_in


def test_fights_go_on_over_a_chunks_end(single, only_fights):
    state = single.states[3]
    for iteration in (1, 2 * CHUNK, 3 * CHUNK):
        assert_same_bits(
            only_fights(CONFIG, state, iteration), jax.tree.map(lambda leaf: leaf[0], state.env)
        )


def test_fights_can_be_set_to_start_anew_with_a_chunk(single, only_fights):
    config = replace(CONFIG, train=replace(CONFIG.train, reset_at_chunk=True))
    state = single.states[3]
    for iteration in (0, CHUNK, 2 * CHUNK):
        new = jax.jit(lambda i: reset_fights(Combat(config), jnp.uint32(4), i))(
            jnp.int32(iteration)
        )
        assert_same_bits(only_fights(config, state, iteration), new)
    assert_same_bits(
        only_fights(config, state, CHUNK + 1), jax.tree.map(lambda leaf: leaf[0], state.env)
    )


def test_clocks_are_drawn_where_all_fights_start_at_once():
    many = replace(CONFIG, train=replace(CONFIG.train, num_envs=2000))
    seed, iteration = jnp.uint32(4), jnp.int32(CHUNK)

    def clocks(config: Config, iteration: jax.Array) -> np.ndarray:
        return np.asarray(reset_fights(Combat(config), seed, iteration).clock)

    drawn = clocks(many, iteration)
    # 100 each expected
    assert np.bincount(drawn, minlength=20).min() > 60 and drawn.min() == 0 and drawn.max() == 19
    assert np.any(drawn != clocks(many, jnp.int32(2 * CHUNK)))
    assert not np.any(clocks(replace(many, game=replace(many.game, random_clock=False)), iteration))


def test_in_the_head_start_only_the_attacker_learns_and_then_both_do(single):
    start, first, ahead, duel = (
        single.states[0],
        single.states[1],
        single.states[CHUNK],
        single.states[CHUNK + 1],
    )
    assert_same_bits(agent(ahead, DEFENDER), agent(start, DEFENDER))
    assert differs(agent(first, ATTACKER).parameters, agent(start, ATTACKER).parameters)
    # the defender is there, and flies as it always did
    assert np.any(ahead.env.qvel[..., :6] != 0.0)
    for role in (DEFENDER, ATTACKER):
        assert differs(agent(duel, role).parameters, agent(ahead, role).parameters)


def test_when_the_defender_waits():
    assert [bool(waits(CONFIG, jnp.int32(i))) for i in range(5)] == [
        True,
        True,
        False,
        False,
        False,
    ]
    solo = replace(CONFIG, game=replace(CONFIG.game, scenario="solo"))
    assert all(bool(waits(solo, jnp.int32(i))) for i in (0, 2, 1000))
    never = replace(CONFIG, train=replace(CONFIG.train, head_start_steps=0))
    assert not any(bool(waits(never, jnp.int32(i))) for i in (0, 2))


def test_no_two_iterations_purposes_or_seeds_share_random_numbers(single):
    """Fights that start in different chunks, and noise in consecutive iterations, differ."""
    env = [
        reset_fights(single.combat, jnp.uint32(s), jnp.int32(i))
        for s, i in ((4, 0), (4, 2), (5, 0))
    ]
    heights = [np.asarray(e.qpos[:, 2]) for e in env]
    assert all(np.all(heights[i] != heights[j]) for i, j in ((0, 1), (0, 2), (1, 2)))
    rates = [np.asarray(state.env.qvel) for state in single.states[1:]]
    assert all(differs(a, b) for a, b in pairwise(rates))
