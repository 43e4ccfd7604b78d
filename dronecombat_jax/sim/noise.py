"""Random numbers that are a function of a fight's word and its clock: nothing is carried but the
word, and a fight flown again sees the same.

JAX's own generator is not used here: its numbers made inside a scan have deadlocked XLA's CPU runtime,
and cost more than the step. Hash: lowbias32 (C. Wellons, "Prospecting for hash functions", 2018).
"""

import jax
import jax.numpy as jnp

GUSTS, NOISE, BIAS, DROPOUT = 1, 2, 3, 4  # streams: what the numbers are for


def word_of(number: jax.Array) -> jax.Array:
    """The word [] of a fight, uint32, from a uniform number [] in [0, 1) of 23 bits or more."""
    return (number * 2.0**24).astype(jnp.uint32)


def uniforms(word: jax.Array, clock: jax.Array, stream: int, count: int) -> jax.Array:
    """`count` numbers [count] in (0, 1), float32."""
    index = jnp.arange(count, dtype=jnp.uint32) + jnp.uint32(stream << 16)
    state = _hash(_hash(word) + clock.astype(jnp.uint32))
    return (_hash(state ^ _hash(index)) >> 8).astype(jnp.float32) * 2.0**-24 + 2.0**-25


def normals(word: jax.Array, clock: jax.Array, stream: int, count: int) -> jax.Array:
    """`count` standard normal numbers [count] (Box and Muller 1958)."""
    radius, angle = uniforms(word, clock, stream, 2 * count).reshape(2, count)
    return jnp.sqrt(-2.0 * jnp.log(radius)) * jnp.cos(2.0 * jnp.pi * angle)


def _hash(value: jax.Array) -> jax.Array:
    value = (value ^ (value >> 16)) * jnp.uint32(0x7FEB352D)
    value = (value ^ (value >> 15)) * jnp.uint32(0x846CA68B)
    return value ^ (value >> 16)
