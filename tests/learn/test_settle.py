"""How learning settles at the end of a training, and the mean of its last policies."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy import CONFIG, assert_same_bits, two_chunks

from dronecombat_jax.config.fields import Config, LearnConfig, TrainConfig
from dronecombat_jax.learn import ppo
from dronecombat_jax.learn.ippo import adopt
from dronecombat_jax.learn.rollout import policy_of
from dronecombat_jax.learn.settle import LAST_RATE, averaged, settled

HUNDRED = TrainConfig(num_envs=1, chunk_iterations=10, total_steps=100 * 24)  # iterations


def settling(**learn) -> Config:
    return Config(learn=LearnConfig(settle_share=0.4, min_log_std=-1.0, **learn), train=HUNDRED)


def test_without_a_share_nothing_changes():
    config = Config(train=HUNDRED)
    assert settled(config, jnp.int32(99)) is config.learn
    assert config.learn.least_log_std == config.learn.min_log_std


@pytest.mark.parametrize(("iteration", "left"), [(0, 1.0), (60, 1.0), (80, 0.5), (100, 0.0)])
def test_rate_and_exploration_fall_over_the_last_share(iteration, left):
    config = settling(settled_log_std=-2.5)
    now = settled(config, jnp.int32(iteration))
    most = config.learn.max_learning_rate
    np.testing.assert_allclose(
        now.max_learning_rate, most * (LAST_RATE + (1 - LAST_RATE) * left), rtol=1e-5
    )
    np.testing.assert_allclose(now.min_log_std, -2.5 + 1.5 * left, rtol=1e-5)
    assert config.learn.least_log_std == -2.5


@pytest.mark.parametrize("schedule", ["kl", "constant"])
def test_a_rate_above_its_bound_comes_down_whatever_the_divergence(schedule):
    config = settling(learning_rate_schedule=schedule)
    now = settled(config, jnp.int32(80))
    for kl in (0.0, config.learn.kl_target, 1.0):
        rate = ppo.adapt_learning_rate(now, jnp.float32(config.learn.max_learning_rate), kl)
        assert rate <= now.max_learning_rate + 1e-9


def test_a_bound_that_is_higher_in_the_end_lowers_nothing():
    config = settling(settled_log_std=0.0)
    assert config.learn.least_log_std == -1.0
    assert settled(config, jnp.int32(100)).min_log_std == -1.0


def test_not_even_the_lower_bound_of_the_rate_keeps_it_up():
    config = settling(min_learning_rate=5e-3)
    now = settled(config, jnp.int32(100))
    for kl in (0.0, 1.0):
        rate = ppo.adapt_learning_rate(now, jnp.float32(config.learn.max_learning_rate), kl)
        np.testing.assert_allclose(rate, LAST_RATE * config.learn.max_learning_rate, rtol=1e-5)


SHORT = replace(CONFIG.train, total_steps=4 * 8 * 6, head_start_steps=0)  # iterations


@pytest.fixture(scope="module")
def plain():
    """A training of four iterations that ends with its last policies."""
    return two_chunks(replace(CONFIG, train=SHORT)).states


@pytest.fixture(scope="module")
def averaging():
    """The same training; the mean of its last three policies is the final one."""
    learn = replace(CONFIG.learn, average_share=0.7)
    return two_chunks(replace(CONFIG, train=SHORT, learn=learn)).states


def test_training_does_not_notice_the_mean_but_for_the_final_policy(plain, averaging):
    without = [state.replace(mean=None) for state in averaging]
    for before, own in zip(plain[:-1], without[:-1], strict=True):
        assert_same_bits(own, before)
    policy = policy_of(plain[-1].learners)
    assert_same_bits(without[-1].replace(learners=adopt(without[-1].learners, policy)), plain[-1])


def test_the_final_policy_is_the_mean_of_those_of_the_last_share(plain, averaging):
    last = [policy_of(state.learners) for state in plain[-3:]]
    mean = jax.tree.map(lambda *leaves: np.mean(leaves, axis=0, dtype=np.float64), *last)
    final = policy_of(averaging[-1].learners)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-6), final, mean)
    assert_same_bits(averaging[-1].mean, final)
    assert np.any(final.network.weights[0] != last[-1].network.weights[0])


def test_no_policy_from_before_the_share_is_in_the_mean(plain, averaging):
    for state, own in zip(plain[:3], averaging[:3], strict=True):
        assert_same_bits(own.mean, policy_of(state.learners))


def test_even_the_smallest_share_holds_the_last_policy(plain):
    config = replace(CONFIG, train=SHORT, learn=replace(CONFIG.learn, average_share=1e-6))
    first, last = (jax.tree.map(lambda leaf: leaf[0], plain[i].learners) for i in (0, -1))
    mean, learners = averaged(config, policy_of(first), last, jnp.int32(3))
    assert_same_bits(learners, last)
    assert_same_bits(mean, policy_of(last))
