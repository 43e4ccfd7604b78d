"""Running mean and variance of observations and returns, as skrl 1.4.3's RunningStandardScaler."""

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.sight import OWN_SIZE, SLOT_SIZE
from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.types import Scaler

EPSILON = 1e-8
CLIP = 5.0
# Of a slot of observation `nearest`: way m, velocity m/s, thrust axis, flag.
SLOT_SCALE = (5.0,) * 6 + (1.0,) * 4


def init_scaler(shape: tuple[int, ...]) -> Scaler:
    """Mean 0, variance 1, and a count of 1, as skrl starts."""
    return Scaler(jnp.zeros(shape), jnp.ones(shape), jnp.ones(()))


def update_scaler(scaler: Scaler, batch: jax.Array, weight: jax.Array) -> Scaler:
    """Take in those rows of `batch` [..., size] whose `weight` [...] is 1; by Chan et al.'s rule,
    ddof 1 as torch.var.

    A batch that would make the statistics NaN or infinite is left out: they could never recover. So
    is an empty one.
    """
    axes = tuple(range(weight.ndim))
    counts = weight.reshape(*weight.shape, *[1] * scaler.mean.ndim)
    count = jnp.sum(weight)
    # Times the reciprocal, not divided by: which of the two XLA compiles, and so the last bit,
    # would be the program's choice.
    mean = jnp.sum(batch * counts, axis=axes) * (1.0 / count)
    variance = jnp.sum((batch - mean) ** 2 * counts, axis=axes) * (1.0 / (count - 1.0))
    total = scaler.count + count
    delta = mean - scaler.mean
    m2 = scaler.variance * scaler.count + variance * count + delta**2 * scaler.count * count / total
    updated = Scaler(scaler.mean + delta * count / total, m2 / total, total)
    finite = jnp.all(jnp.isfinite(updated.mean) & jnp.isfinite(updated.variance))
    return jax.tree.map(lambda new, old: jnp.where(finite, new, old), updated, scaler)


def normalize(scaler: Scaler, x: jax.Array) -> jax.Array:
    """(x - mean) / std, clipped to +-5."""
    return jnp.clip((x - scaler.mean) / (jnp.sqrt(scaler.variance) + EPSILON), -CLIP, CLIP)


def denormalize(scaler: Scaler, x: jax.Array) -> jax.Array:
    """Back to the original scale; `x` is clipped to +-5 first."""
    return jnp.sqrt(scaler.variance) * jnp.clip(x, -CLIP, CLIP) + scaler.mean


def with_fixed_slots(learn: LearnConfig, scaler: Scaler) -> Scaler:
    """The same, but that a network which takes the mean over slots (`learn.others`) has each slot
    scaled alike, whatever has been seen in it: SLOT_SCALE, mean 0.
    """
    if learn.others != "mean":
        return scaler
    slots = (scaler.mean.shape[-1] - OWN_SIZE) // SLOT_SIZE
    variance = jnp.tile(jnp.asarray(SLOT_SCALE) ** 2, slots)
    return scaler.replace(
        mean=scaler.mean.at[..., OWN_SIZE:].set(0.0),
        variance=scaler.variance.at[..., OWN_SIZE:].set(variance),
    )
