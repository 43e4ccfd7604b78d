"""How learning settles at the end of a training: smaller steps and less exploration
(`learn.settle_share`), and the mean of the last policies as the final one (`learn.average_share`).

In self-play neither side stands still for the other: with a rate that never falls the last policy is
one of many that circle about each other, and no better than those before it. A rate that falls lets
both come to rest; the mean of their weights is what they circle about (Polyak and Juditsky 1992;
Izmailov et al. 2018, arXiv 1803.05407). What does not live here: the learner (`ippo`) and the rate
within the bounds (`ppo.adapt_learning_rate`).
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp

from dronecombat_jax.config.fields import Config, LearnConfig
from dronecombat_jax.learn.algorithms import Learners, algorithm_of
from dronecombat_jax.types import Policy

LAST_RATE = 0.01  # of `max_learning_rate`, in the end


def settled(config: Config, iteration: jax.Array) -> LearnConfig:
    """The settings of learning in an iteration: `max_learning_rate` and `min_log_std` are traced numbers
    where they fall, linearly over the last `learn.settle_share` of all iterations.
    """
    learn = config.learn
    if learn.settle_share == 0.0:
        return learn
    iterations = _iterations(config)
    left = (1.0 - iteration / iterations) / learn.settle_share  # of the time to settle
    left = jnp.clip(left, 0.0, 1.0)
    rate = learn.max_learning_rate * (LAST_RATE + (1.0 - LAST_RATE) * left)
    bound = learn.least_log_std + (learn.min_log_std - learn.least_log_std) * left
    changed: dict[str, Any] = {"max_learning_rate": rate, "min_log_std": bound}
    return dataclasses.replace(learn, **changed)


def first_mean(config: Config, learners: Learners) -> Policy | None:
    """The mean before any policy is in it; `learners` with any leading axes. None: nothing is averaged."""
    return algorithm_of(config.learn).policy(learners) if config.learn.average_share else None


def averaged(
    config: Config, mean: Policy | None, learners: Learners, iteration: jax.Array
) -> tuple[Policy | None, Learners]:
    """The mean with the policies of `iteration` in it, and the learners, both [L, ...].

    Every policy of the last `learn.average_share` of all iterations counts the same. The learners
    are returned as they are, but after the last iteration: then the mean takes the place of their
    policies. So it is in the last checkpoint, and a run that goes on learns from there.
    """
    if mean is None:
        return None, learners
    algorithm, iterations = algorithm_of(config.learn), _iterations(config)
    first = min(round(iterations * (1.0 - config.learn.average_share)), iterations - 1)
    number = jnp.maximum(iteration - first + 1, 1)  # of those in it; 1 as long as none counts
    policy = algorithm.policy(learners)
    taken = lambda old, new: jnp.where(number == 1, new, old + (new - old) / number)
    mean = jax.tree.map(taken, mean, policy)
    learners = jax.lax.cond(
        iteration + 1 == iterations, jax.vmap(algorithm.adopt), lambda own, _: own, learners, mean
    )
    return mean, learners


def _iterations(config: Config) -> int:
    """Of the whole training."""
    return config.num_chunks * config.train.chunk_iterations
