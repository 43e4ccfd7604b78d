"""PPO's mathematics on plain arrays: advantages, losses, the KL schedule. No networks, no loops
over data.

Every mean is over the steps that count: `weight` is 1 for them and 0 for all others (MAPPO's active
masks, Yu et al. 2022).

Sources: GAE, Schulman 2016 (eq. 15); PPO, Schulman 2017 (eq. 14, 16); forms as in skrl 1.4.3.
"""

from typing import Literal

import jax
import jax.numpy as jnp

from dronecombat_jax.config.fields import LearnConfig


def generalized_advantages(
    reward: jax.Array,
    value: jax.Array,
    next_value: jax.Array,
    terminated: jax.Array,
    done: jax.Array,
    discount: float,
    gae_lambda: float,
) -> jax.Array:
    """Advantages [T, ...] of eq. 15, not normalised.

    `next_value[t]` is the value of the state that step t led to, before any reset; it counts unless
    `terminated[t]`. `done[t]` (terminated or truncated) cuts the trace. All arguments [T, ...].
    """
    delta = reward + discount * next_value * ~terminated - value

    def backward(advantage: jax.Array, step: tuple[jax.Array, jax.Array]):
        delta_t, done_t = step
        advantage = delta_t + discount * gae_lambda * ~done_t * advantage
        return advantage, advantage

    _, advantages = jax.lax.scan(backward, jnp.zeros_like(delta[0]), (delta, done), reverse=True)
    return advantages


def weighted_mean(x: jax.Array, weight: jax.Array) -> jax.Array:
    """Mean of `x` where `weight` is 1, both [...]; 0 where every weight is 0. Values of weight 0
    must be finite, too.
    """
    return jnp.sum(x * weight) / jnp.maximum(jnp.sum(weight), 1.0)


def normalize_advantages(advantage: jax.Array, weight: jax.Array) -> jax.Array:
    """Zero mean, unit deviation (ddof 1) over those steps of the whole rollout whose `weight` is 1;
    0 elsewhere.
    """
    counted = weight > 0.0
    deviation = jnp.where(
        counted, advantage - weighted_mean(jnp.where(counted, advantage, 0.0), weight), 0.0
    )
    variance = jnp.sum(deviation**2) / jnp.maximum(jnp.sum(weight) - 1.0, 1.0)
    return deviation / (jnp.sqrt(variance) + 1e-8)


def policy_loss(
    log_ratio: jax.Array, advantage: jax.Array, weight: jax.Array, clip: float
) -> jax.Array:
    """Clipped surrogate loss (eq. 16), a scalar to minimise; arguments [B]."""
    ratio = jnp.exp(log_ratio)
    clipped = jnp.clip(ratio, 1.0 - clip, 1.0 + clip)
    return -weighted_mean(jnp.minimum(ratio * advantage, clipped * advantage), weight)


def value_loss(
    value: jax.Array,
    old_value: jax.Array,
    target: jax.Array,
    weight: jax.Array,
    clip: float,
    form: Literal["skrl", "ppo2_max", "paper_min", "plain"],
) -> jax.Array:
    """Value loss (eq. 17), a scalar; arguments [B], normalised units.

    skrl: the clipped prediction alone; ppo2_max: the larger of clipped and plain (OpenAI
    baselines); paper_min: the smaller, as eq. 17 prints it; plain: no clip.
    """
    plain = (value - target) ** 2
    clipped = (old_value + jnp.clip(value - old_value, -clip, clip) - target) ** 2
    forms = {
        "skrl": lambda: clipped,
        "ppo2_max": lambda: jnp.maximum(plain, clipped),
        "paper_min": lambda: jnp.minimum(plain, clipped),
        "plain": lambda: plain,
    }
    return weighted_mean(forms[form](), weight)


def teacher_loss(mean: jax.Array, lesson: jax.Array, weight: jax.Array) -> jax.Array:
    """Half the squared distance of a policy's mean action to its teacher's, both [4, B]; a scalar.

    It is the divergence between Gaussians of deviation 1 about both: kickstarting (Schmitt et al. 2018,
    arXiv 1803.03835) with a teacher that is no network.
    """
    return weighted_mean(0.5 * jnp.sum((mean - lesson) ** 2, axis=0), weight)


def approximate_kl(log_ratio: jax.Array, weight: jax.Array) -> jax.Array:
    """Mean of (r - 1) - log r, Schulman's k3 estimate."""
    return weighted_mean(jnp.expm1(log_ratio) - log_ratio, weight)


def adapt_learning_rate(learn: LearnConfig, learning_rate: jax.Array, kl: jax.Array) -> jax.Array:
    """The KL-adaptive rate after an epoch with mean divergence `kl` (skrl's KLAdaptiveLR)."""
    if learn.learning_rate_schedule == "constant":
        return _bounded(learn, learning_rate)
    lower = jnp.maximum(learning_rate / learn.learning_rate_factor, learn.min_learning_rate)
    higher = jnp.minimum(learning_rate * learn.learning_rate_factor, learn.max_learning_rate)
    adapted = jnp.where(kl < learn.kl_target / learn.kl_factor, higher, learning_rate)
    adapted = jnp.where(kl > learn.kl_target * learn.kl_factor, lower, adapted)
    return _bounded(learn, adapted)


def _bounded(learn: LearnConfig, learning_rate: jax.Array) -> jax.Array:
    """The rate below its upper bound where that falls (`settle`)."""
    return (
        jnp.minimum(learning_rate, learn.max_learning_rate) if learn.settle_share else learning_rate
    )


def explained_variance(target: jax.Array, value: jax.Array, weight: jax.Array) -> jax.Array:
    """1 - Var(target - value) / Var(target); 0 where the target is constant."""
    variance = lambda x: weighted_mean((x - weighted_mean(x, weight)) ** 2, weight)
    whole = variance(target)
    explained = 1.0 - variance(target - value) / jnp.maximum(whole, 1e-12)
    return jnp.where(whole > 1e-12, explained, 0.0)
