"""PPO's mathematics on plain arrays: advantages, losses, the KL schedule. No networks, no loops over data.

Sources: GAE, Schulman 2016 (eq. 15); PPO, Schulman 2017 (eq. 14, 16); forms as in skrl 1.4.3.
"""

from typing import Literal

import jax
import jax.numpy as jnp

from dronecombat_jax.config import LearnConfig


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


def normalize_advantages(advantage: jax.Array) -> jax.Array:
    """Zero mean, unit deviation (ddof 1) over the whole rollout."""
    return (advantage - jnp.mean(advantage)) / (jnp.std(advantage, ddof=1) + 1e-8)


def policy_loss(log_ratio: jax.Array, advantage: jax.Array, clip: float) -> jax.Array:
    """Clipped surrogate loss (eq. 16), a scalar to minimise; arguments [B]."""
    ratio = jnp.exp(log_ratio)
    clipped = jnp.clip(ratio, 1.0 - clip, 1.0 + clip)
    return -jnp.mean(jnp.minimum(ratio * advantage, clipped * advantage))


def value_loss(
    value: jax.Array,
    old_value: jax.Array,
    target: jax.Array,
    clip: float,
    form: Literal["skrl", "ppo2_max", "paper_min", "plain"],
) -> jax.Array:
    """Value loss (eq. 17), a scalar; arguments [B], normalised units.

    skrl: the clipped prediction alone; ppo2_max: the larger of clipped and plain (OpenAI baselines);
    paper_min: the smaller, as eq. 17 prints it; plain: no clip.
    """
    plain = (value - target) ** 2
    clipped = (old_value + jnp.clip(value - old_value, -clip, clip) - target) ** 2
    forms = {
        "skrl": lambda: clipped,
        "ppo2_max": lambda: jnp.maximum(plain, clipped),
        "paper_min": lambda: jnp.minimum(plain, clipped),
        "plain": lambda: plain,
    }
    return jnp.mean(forms[form]())


def approximate_kl(log_ratio: jax.Array) -> jax.Array:
    """Mean of (r - 1) - log r, Schulman's k3 estimate."""
    return jnp.mean(jnp.expm1(log_ratio) - log_ratio)


def adapt_learning_rate(learn: LearnConfig, learning_rate: jax.Array, kl: jax.Array) -> jax.Array:
    """The KL-adaptive rate after an epoch with mean divergence `kl` (skrl's KLAdaptiveLR)."""
    if learn.learning_rate_schedule == "constant":
        return learning_rate
    lower = jnp.maximum(learning_rate / learn.learning_rate_factor, learn.min_learning_rate)
    higher = jnp.minimum(learning_rate * learn.learning_rate_factor, learn.max_learning_rate)
    adapted = jnp.where(kl < learn.kl_target / learn.kl_factor, higher, learning_rate)
    return jnp.where(kl > learn.kl_target * learn.kl_factor, lower, adapted)


def explained_variance(target: jax.Array, value: jax.Array) -> jax.Array:
    """1 - Var(target - value) / Var(target); 0 where the target is constant."""
    variance = jnp.var(target)
    explained = 1.0 - jnp.var(target - value) / jnp.maximum(variance, 1e-12)
    return jnp.where(variance > 1e-12, explained, 0.0)
