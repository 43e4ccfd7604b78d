"""A gated recurrent unit (Cho et al. 2014), features first as the networks are, in the form of
PyTorch and cuDNN: the reset gate acts behind the product.

What does not live here: where it stands in a policy (`memory`), the gradient steps (`optimize`).
"""

import jax
import jax.numpy as jnp

from dronecombat_jax.types import GRU

GATES = 3  # reset, update, candidate: the order of the columns


def init_gru(key: jax.Array, inputs: int, size: int) -> GRU:
    """Orthogonal weights of gain 1, gate by gate, and zero biases."""
    draw = jax.nn.initializers.orthogonal(1.0)
    keys = jax.random.split(key, 2 * GATES)
    side_by_side = lambda keys, rows: jnp.concatenate(
        [draw(each, (rows, size), jnp.float32) for each in keys], axis=1
    )
    return GRU(
        weights=side_by_side(keys[:GATES], inputs),
        state_weights=side_by_side(keys[GATES:], size),
        biases=jnp.zeros(GATES * size),
        candidate_bias=jnp.zeros(size),
    )


def gru_step(gru: GRU, x: jax.Array, state: jax.Array) -> jax.Array:
    """The state [H, ...] after inputs `x` [in, ...], `state` [H, ...] being the one before."""
    return _step(gru, _of_inputs(gru, x), state)


def unroll(gru: GRU, x: jax.Array, state: jax.Array, fresh: jax.Array) -> jax.Array:
    """The states [H, T, B] after each of the inputs `x` [in, T, B], from `state` [H, B] on; 0 before
    a step that is `fresh` [T, B].
    """

    def step(state: jax.Array, now: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        gates, begins = now
        state = _step(gru, gates, jnp.where(begins, 0.0, state))
        return state, state

    gates = jnp.moveaxis(_of_inputs(gru, x), 1, 0)  # one product for all steps
    return jnp.moveaxis(jax.lax.scan(step, state, (gates, fresh))[1], 0, 1)


def _of_inputs(gru: GRU, x: jax.Array) -> jax.Array:
    return jnp.tensordot(gru.weights, x, axes=(0, 0)) + _column(gru.biases, x.ndim)


def _step(gru: GRU, gates: jax.Array, state: jax.Array) -> jax.Array:
    """The next state, `gates` [3 H, ...] being the inputs' part of all three."""
    reset, update, candidate = jnp.split(gates, GATES)
    of_state = jnp.split(jnp.tensordot(gru.state_weights, state, axes=(0, 0)), GATES)
    reset = jax.nn.sigmoid(reset + of_state[0])
    update = jax.nn.sigmoid(update + of_state[1])
    bias = _column(gru.candidate_bias, state.ndim)
    candidate = jnp.tanh(candidate + reset * (of_state[2] + bias))
    return (1.0 - update) * candidate + update * state


def _column(bias: jax.Array, ndim: int) -> jax.Array:
    return bias.reshape(-1, *[1] * (ndim - 1))
