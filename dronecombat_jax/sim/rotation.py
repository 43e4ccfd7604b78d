"""Unit quaternions, wxyz, body to world, batched over leading axes. Plain array functions."""

import jax
import jax.numpy as jnp


def body_z(quaternion: jax.Array) -> jax.Array:
    """The body's z axis in the world frame: third column [..., 3] of the rotation matrix."""
    w, x, y, z = (quaternion[..., i] for i in range(4))
    return jnp.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=-1)


def rotate(quaternion: jax.Array, vector: jax.Array) -> jax.Array:
    """Body frame to world frame: R v, both [..., 3]."""
    scalar, axis = quaternion[..., :1], quaternion[..., 1:]
    twice = 2.0 * jnp.cross(axis, vector)
    return vector + scalar * twice + jnp.cross(axis, twice)


def rotate_inverse(quaternion: jax.Array, vector: jax.Array) -> jax.Array:
    """World frame to body frame: R^T v, both [..., 3]."""
    return rotate(conjugate(quaternion), vector)


def conjugate(quaternion: jax.Array) -> jax.Array:
    """The inverse rotation of a unit quaternion."""
    return quaternion * jnp.asarray([1.0, -1.0, -1.0, -1.0], quaternion.dtype)


def multiply(left: jax.Array, right: jax.Array) -> jax.Array:
    """Hamilton product [..., 4]: first `right`, then `left`."""
    w1, v1 = left[..., :1], left[..., 1:]
    w2, v2 = right[..., :1], right[..., 1:]
    scalar = w1 * w2 - jnp.sum(v1 * v2, axis=-1, keepdims=True)
    return jnp.concatenate([scalar, w1 * v2 + w2 * v1 + jnp.cross(v1, v2)], axis=-1)
