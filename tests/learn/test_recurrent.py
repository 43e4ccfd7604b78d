"""The gated recurrent unit against flax's, and its unrolling against single steps."""

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen

from dronecombat_jax.learn.recurrent import gru_step, init_gru, unroll

INPUTS, SIZE = 5, 3


def drawn_gru():
    """With biases that are not 0."""
    gru = init_gru(jax.random.key(0), INPUTS, SIZE)
    keys = jax.random.split(jax.random.key(1))
    return gru.replace(
        biases=jax.random.normal(keys[0], gru.biases.shape),
        candidate_bias=jax.random.normal(keys[1], gru.candidate_bias.shape),
    )


def test_a_step_is_that_of_flax():
    """Its gates: r reset, z update, n candidate; i of the inputs, h of the state."""
    gru = drawn_gru()
    of_inputs, biases = (jnp.split(leaf, 3, axis=-1) for leaf in (gru.weights, gru.biases))
    of_state = jnp.split(gru.state_weights, 3, axis=-1)
    layers = {}
    for number, gate in enumerate("rzn"):
        layers[f"i{gate}"] = {"kernel": of_inputs[number], "bias": biases[number]}
        layers[f"h{gate}"] = {"kernel": of_state[number]}
    layers["hn"]["bias"] = gru.candidate_bias
    x = jax.random.normal(jax.random.key(2), (7, INPUTS))
    state = jax.random.normal(jax.random.key(3), (7, SIZE))
    wanted, _ = linen.GRUCell(SIZE).apply({"params": layers}, state, x)
    np.testing.assert_allclose(gru_step(gru, x.T, state.T).T, wanted, atol=1e-6)


def test_unrolled_it_is_one_step_after_the_other_and_begins_anew_where_a_fight_does():
    gru = drawn_gru()
    x = jax.random.normal(jax.random.key(2), (INPUTS, 6, 4))
    state = start = jax.random.normal(jax.random.key(3), (SIZE, 4))
    fresh = jnp.zeros((6, 4), bool).at[2, 1].set(True).at[5, 3].set(True)
    states = unroll(gru, x, start, fresh)
    for step in range(6):
        before = jnp.where(fresh[step], 0.0, state)
        state = gru_step(gru, x[:, step], before)
        np.testing.assert_allclose(states[:, step], state, atol=1e-6)


def test_its_weights_are_orthogonal_gate_by_gate():
    gru = init_gru(jax.random.key(0), 9, 4)
    for weights in (gru.weights, gru.state_weights):
        for gate in np.split(np.asarray(weights), 3, axis=1):
            np.testing.assert_allclose(gate.T @ gate, np.eye(4), atol=1e-5)
    assert not np.any(gru.biases) and not np.any(gru.candidate_bias)
