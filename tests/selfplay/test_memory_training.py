"""Training policies that remember their fight, at toy size, against past ones."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from toy import CHUNK, CONFIG, assert_same_bits, build

from dronecombat_jax.config.fields import Config, SelfPlayConfig
from dronecombat_jax.selfplay.chunk import begin_chunk
from dronecombat_jax.types import ATTACKER

MEMORY = replace(CONFIG, learn=replace(CONFIG.learn, memory="frames", frames=3))
WITH_PAST = "attacker=past 0.5"


def playing(opponents: str) -> Config:
    train = replace(CONFIG.train, head_start_steps=0)
    return replace(MEMORY, train=train, selfplay=SelfPlayConfig(opponents=opponents))


@pytest.fixture(scope="module")
def trained():
    """Half of the environments against past attackers; before the second chunk begins."""
    program = build(playing(WITH_PAST), CHUNK)
    return program, program.run(program.start)[0]


@pytest.mark.long
def test_it_trains_and_its_fights_remember(trained):
    program, state = trained
    recall = np.asarray(state.env.recall)
    assert recall.shape == (1, CONFIG.train.num_envs, 2, 70) and np.any(recall)
    assert np.all(np.isfinite(recall))
    pool = state.selfplay.pools[ATTACKER]
    assert pool.policies.network.weights[0].shape[-2] == 105
    moved = (
        state.learners.parameters.policy.weights[0]
        - program.start.learners.parameters.policy.weights[0]
    )
    # also by what it remembers: the rows of past observations
    assert np.any(np.asarray(moved)[0, :, 35:] != 0.0)


@pytest.mark.long
def test_who_meets_another_opponent_begins_without_memory_and_nobody_else(trained):
    program, state = trained
    (seed,) = [jax.tree.map(lambda leaf: leaf[0], state)]
    after = jax.jit(lambda state: begin_chunk(program.combat, state))(seed)
    other = np.asarray(seed.selfplay.opponent != after.selfplay.opponent)
    assert 0 < other.sum() < len(other)
    assert not np.any(after.env.recall[other])
    assert_same_bits(after.env.recall[~other], seed.env.recall[~other])


@pytest.mark.slow
def test_a_recurrent_policy_trains_beside_a_central_critic():
    learn = replace(CONFIG.learn, memory="gru", memory_size=6, critic="central")
    program = build(replace(playing(""), learn=learn), 1)
    state, report = program.run(program.start)
    before, after = program.start.learners.parameters, state.learners.parameters
    assert state.env.recall.shape == (1, CONFIG.train.num_envs, 2, 6) and np.any(state.env.recall)
    for moved in jax.tree.leaves(jax.tree.map(lambda new, old: new != old, after.gru, before.gru)):
        assert np.all(np.any(moved, axis=tuple(range(2, moved.ndim))))  # of both sides
    assert after.value.weights[0].shape[-2] == 37  # the whole state alone
    assert np.all(np.isfinite(report.learners.value_loss)) and not np.any(report.learners.skipped)
