"""Environments in which the attacker flies alone: who is absent there, who learns from them, what
is counted.
"""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy import CONFIG, UNOPTIMISED, Coasting, agent, assert_same_bits, build, differs

from dronecombat_jax.config.fields import SelfPlayConfig
from dronecombat_jax.learn.algorithms import ALL, learn_from
from dronecombat_jax.learn.ippo import init_learner
from dronecombat_jax.learn.rollout import collect, policy_of, select
from dronecombat_jax.selfplay.chunk import reset_fights
from dronecombat_jax.types import ATTACKER, DEFENDER, Transition

ALONE, TOGETHER = 2, 6  # environments
ITERATIONS = 4
# Every fight ends with its first step: what is counted is known beforehand.
SHARED = replace(
    CONFIG,
    game=replace(CONFIG.game, episode_steps=1),
    train=replace(CONFIG.train, solo_share=0.25, start_speed=3.0, head_start_steps=0),
    selfplay=SelfPlayConfig(probability=1.0, memory=1.0),
)


@pytest.fixture(scope="module")
def run() -> SimpleNamespace:
    program = build(SHARED, ITERATIONS)
    state, report = program.run(program.start)
    return SimpleNamespace(start=program.start, state=state, report=report)


@pytest.fixture(scope="module")
def rollout() -> Transition:
    """A rollout of the toy game with fights long enough to learn from."""
    config = replace(SHARED, game=CONFIG.game)
    combat, key = Coasting(config), jax.random.key(0)

    def fly() -> Transition:
        learners = jax.vmap(lambda key: init_learner(key, config.learn))(jax.random.split(key))
        policies = policy_of(select(learners, DEFENDER)), policy_of(select(learners, ATTACKER))
        return collect(
            combat, policies, reset_fights(combat, jnp.uint32(0), jnp.int32(0)), key, key
        )[1]

    return jax.jit(fly, compiler_options=UNOPTIMISED)()


@pytest.mark.long
def test_the_first_environments_are_the_attackers_alone_in_every_fight(run):
    for state in (run.start, run.state):
        np.testing.assert_array_equal(state.env.down[0, :, DEFENDER], np.arange(8) < ALONE)
        assert not np.any(state.env.down[..., ATTACKER])
        velocity = np.asarray(state.env.qvel[0]).reshape(8, 2, 6)[:, :, :2]
        assert not np.any(velocity[:ALONE, DEFENDER]) and np.all(velocity[ALONE:] != 0.0)


@pytest.mark.long
def test_only_fights_of_both_are_counted(run):
    ended = CONFIG.learn.rollout_steps * TOGETHER
    np.testing.assert_array_equal(run.report.causes.sum(-1), np.full((1, ITERATIONS), ended))
    frozen = np.asarray(run.report.frozen[0]) == ATTACKER
    assert np.any(frozen)
    _, attackers = run.state.selfplay.pools
    assert attackers.games.sum() == ended * frozen.sum()


@pytest.mark.long
def test_the_defender_learns_from_nothing_that_happened_without_it(rollout):
    key, learn = jax.random.key(1), SHARED.learn
    learners = jax.vmap(lambda key: init_learner(key, learn))(jax.random.split(key))

    def learnt(rollout: Transition, solo_envs: int):
        both = jnp.ones(2, bool)
        program = lambda learners, rollout: learn_from(
            learn, learners, rollout, key, both, (slice(solo_envs, None), ALL)
        )[0]
        after = jax.jit(program, compiler_options=UNOPTIMISED)(learners, rollout)
        return SimpleNamespace(learners=jax.tree.map(lambda leaf: leaf[None], after))

    changed = jax.tree.map(lambda leaf: leaf.at[:, :ALONE].set(leaf[:, ALONE : 2 * ALONE]), rollout)
    few = jax.tree.map(lambda leaf: leaf[:, ALONE:], rollout)
    here, there, smaller = learnt(rollout, ALONE), learnt(changed, ALONE), learnt(few, 0)
    assert_same_bits(agent(here, DEFENDER), agent(there, DEFENDER))
    assert_same_bits(agent(here, DEFENDER), agent(smaller, DEFENDER))
    assert differs(agent(here, ATTACKER), agent(there, ATTACKER))  # the attacker learns from them


def test_the_share_is_rounded_to_whole_environments():
    shares = [0.0, 0.05, 0.25, 0.5]
    assert [
        replace(CONFIG, train=replace(CONFIG.train, solo_share=share)).solo_envs for share in shares
    ] == [
        0,
        0,
        2,
        4,
    ]
