"""How learning settles at the end of a training."""

import jax.numpy as jnp
import numpy as np
import pytest

from dronecombat_jax.config.fields import Config, LearnConfig, TrainConfig
from dronecombat_jax.learn import ppo
from dronecombat_jax.learn.settle import LAST_RATE, settled

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
