"""Collecting experience on a probe environment: resets, final observations, what is stored."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from dronecombat_jax.config.fields import Config, LearnConfig
from dronecombat_jax.learn.ippo import init_learner
from dronecombat_jax.learn.networks import gaussian_log_prob, project_log_std
from dronecombat_jax.learn.rollout import act, collect, policy_mean, policy_of, select
from dronecombat_jax.types import Cause, Scaler

LEARN = LearnConfig(hidden_sizes=(8,), rollout_steps=7)
NUM_ENVS = 5


def flying(learners):
    return policy_of(select(learners, 0)), policy_of(select(learners, 1))


@pytest.fixture(scope="module")
def learners():
    trained = jax.vmap(lambda key: init_learner(key, LEARN))(jax.random.split(jax.random.key(0)))
    scaler = Scaler(jnp.full((2, 35), 0.25), jnp.full((2, 35), 4.0), jnp.full(2, 9.0))
    log_std = jnp.asarray([[-1.0, 0.0, 0.5, 3.0]] * 2)  # the last is above its bound of 2
    return trained.replace(
        observation_scaler=scaler, parameters=trained.parameters.replace(log_std=log_std)
    )


@pytest.fixture(scope="module")
def flown(make_probe, make_task, learners):
    probe = make_probe(Config(learn=LEARN), make_task(length=3, constant=(1.0, 2.0)))
    start = jax.vmap(probe.spawn)(probe.start_numbers(jax.random.key(1), (NUM_ENVS,)))
    start = start.replace(clock=jnp.arange(NUM_ENVS, dtype=jnp.int32) % 3)
    return start, *jax.jit(
        lambda: collect(probe, flying(learners), start, jax.random.key(2), jax.random.key(3))
    )()


def test_a_fight_that_ends_is_replaced_and_its_final_observation_is_kept(flown):
    start, after, rollout = flown
    assert rollout.observation.shape == (7, NUM_ENVS, 2, 35) and rollout.action.shape == (
        7,
        NUM_ENVS,
        2,
        4,
    )
    clock = start.clock[None] + np.arange(7)[:, None]
    seen, final = rollout.observation[..., 0, 1], rollout.final_observation[..., 0, 1]
    assert np.array_equal(seen, clock % 3)  # flown so far: back at 0 after three steps
    assert np.array_equal(final, clock % 3 + 1)  # never 0: from before the reset
    done = clock % 3 == 2
    assert np.array_equal(rollout.terminated, done) and not np.any(rollout.truncated)
    assert np.array_equal(rollout.cause, np.where(done, Cause.REACHED, Cause.NONE))
    x = rollout.observation[..., 0, 0]
    assert np.array_equal(x[1:][~done[:-1]], x[:-1][~done[:-1]])  # within a fight x stays
    assert np.any(x[1:][done[:-1]] != x[:-1][done[:-1]])  # a new fight draws its own
    assert np.array_equal(after.clock, (clock[-1] + 1) % 3)


def test_actions_are_unclipped_and_their_log_probability_is_that_of_the_gaussian(flown, learners):
    _, _, rollout = flown
    std = np.exp([-1.0, 0.0, 0.5, 2.0])
    for agent in range(2):
        mean = policy_mean(LEARN, flying(learners)[agent], rollout.observation[:, :, agent])
        expected = stats.norm.logpdf(rollout.action[:, :, agent], mean, std).sum(-1)
        np.testing.assert_allclose(rollout.log_prob[:, :, agent], expected, rtol=1e-4)
    assert np.abs(rollout.action).max() > 2.0
    noise = (
        rollout.action[:, :, 0]
        - policy_mean(LEARN, flying(learners)[0], rollout.observation[:, :, 0])
    ) / std
    assert len(np.unique(np.round(noise, 5))) == noise.size and np.std(noise) == pytest.approx(
        1.0, abs=0.25
    )


def test_recomputed_log_probabilities_have_ratio_one(flown, learners):
    """The observation statistics stand still between collecting and learning."""
    _, _, rollout = flown
    for agent in range(2):
        learner = select(learners, agent)
        mean = policy_mean(LEARN, policy_of(learner), rollout.observation[:, :, agent])
        log_std = project_log_std(learner.parameters, LEARN).log_std
        again = gaussian_log_prob(rollout.action[:, :, agent], mean, log_std)
        np.testing.assert_allclose(again, rollout.log_prob[:, :, agent], rtol=1e-6, atol=1e-6)


def test_the_authors_setting_clips_the_action_and_takes_its_log_probability(learners):
    learn = replace(LEARN, clip_actions=True)
    observation = jax.random.normal(jax.random.key(4), (NUM_ENVS, 2, 35))
    noise = 3.0 * jax.random.normal(jax.random.key(5), (NUM_ENVS, 2, 4))
    action, log_prob, _ = act(learn, flying(learners), observation, noise)
    assert np.abs(action).max() == 1.0
    mean = policy_mean(learn, flying(learners)[1], observation[:, 1])
    expected = stats.norm.logpdf(action[:, 1], mean, np.exp([-1.0, 0.0, 0.5, 2.0])).sum(-1)
    np.testing.assert_allclose(log_prob[:, 1], expected, rtol=1e-4)


def test_each_agent_scales_with_its_own_statistics(learners):
    observation = jax.random.normal(jax.random.key(6), (35,))
    plain = replace(LEARN, normalize_observations=False)
    by_hand = policy_mean(plain, flying(learners)[0], (observation - 0.25) / 2.0)
    np.testing.assert_allclose(
        policy_mean(LEARN, flying(learners)[0], observation), by_hand, rtol=1e-5, atol=1e-6
    )
