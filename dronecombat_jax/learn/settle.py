"""How learning settles at the end of a training: smaller steps, less exploration (`learn.settle_share`).

In self-play neither side stands still for the other: with a rate that never falls the last policy is
one of many that circle about each other, and no better than those before it. A rate that falls lets
both come to rest. What does not live here: the learner (`ippo`) and the rate within the bounds
(`ppo.adapt_learning_rate`).
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp

from dronecombat_jax.config.fields import Config, LearnConfig

LAST_RATE = 0.01  # of `max_learning_rate`, in the end


def settled(config: Config, iteration: jax.Array) -> LearnConfig:
    """The settings of learning in an iteration: `max_learning_rate` and `min_log_std` are traced numbers
    where they fall, linearly over the last `learn.settle_share` of all iterations.
    """
    learn = config.learn
    if learn.settle_share == 0.0:
        return learn
    iterations = config.num_chunks * config.train.chunk_iterations
    left = (1.0 - iteration / iterations) / learn.settle_share  # of the time to settle
    left = jnp.clip(left, 0.0, 1.0)
    rate = learn.max_learning_rate * (LAST_RATE + (1.0 - LAST_RATE) * left)
    bound = learn.least_log_std + (learn.min_log_std - learn.least_log_std) * left
    changed: dict[str, Any] = {"max_learning_rate": rate, "min_log_std": bound}
    return dataclasses.replace(learn, **changed)
