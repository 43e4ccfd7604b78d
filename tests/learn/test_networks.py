"""Networks: the initialisation, the forward pass and the Gaussian, against NumPy and SciPy."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.learn.networks import (
    elu,
    forward,
    gaussian_entropy,
    gaussian_log_prob,
    init_mlp,
    init_parameters,
    project_log_std,
)

LEARN = LearnConfig(
    hidden_sizes=(48, 24), hidden_gain=1.5, policy_output_gain=0.25, initial_log_std=-0.5
)
PARAMETERS = jax.jit(lambda: init_parameters(jax.random.key(3), LEARN))()


def test_sizes_biases_and_log_std():
    assert [w.shape for w in PARAMETERS.policy.weights] == [(35, 48), (48, 24), (24, 4)]
    assert [w.shape for w in PARAMETERS.value.weights] == [(35, 48), (48, 24), (24, 1)]
    assert not any(np.any(b) for mlp in (PARAMETERS.policy, PARAMETERS.value) for b in mlp.biases)
    assert PARAMETERS.log_std.tolist() == [-0.5] * 4
    assert {leaf.dtype for leaf in jax.tree.leaves(PARAMETERS)} == {np.dtype("float32")}


@pytest.mark.parametrize(
    ("name", "gains"),
    [("policy", [1.5, 1.5, 0.25]), ("value", [1.5, 1.5, 1.5])],
    ids=["policy", "value"],
)
def test_weights_are_orthogonal_with_their_gain(name, gains):
    for weight, gain in zip(getattr(PARAMETERS, name).weights, gains, strict=True):
        w = np.asarray(weight, np.float64)
        gram = w.T @ w if w.shape[0] >= w.shape[1] else w @ w.T
        np.testing.assert_allclose(gram, gain**2 * np.eye(len(gram)), atol=1e-5)


def test_the_paper_has_gain_sqrt_2_everywhere_and_no_noise_bonus():
    learn = LearnConfig()
    assert (learn.hidden_gain, learn.policy_output_gain, learn.initial_log_std) == (
        2.0**0.5,
        2.0**0.5,
        0.0,
    )


def test_no_two_layers_start_alike():
    first = PARAMETERS.policy.weights[0]
    assert np.abs(first - PARAMETERS.value.weights[0]).max() > 0.1
    square = init_mlp(jax.random.key(0), (8, 8, 8), 1.0, 1.0)
    assert np.abs(square.weights[0] - square.weights[1]).max() > 0.1
    other = init_parameters(jax.random.key(4), LEARN)
    assert np.abs(first - other.policy.weights[0]).max() > 0.1


def test_forward_is_affine_elu_affine_elu_affine():
    rng = np.random.default_rng(0)
    mlp = PARAMETERS.policy.replace(
        biases=tuple(
            jnp.asarray(rng.normal(size=b.shape), jnp.float32) for b in PARAMETERS.policy.biases
        )
    )
    x = rng.normal(size=(5, 2, 35))
    y = x
    for i, (weight, bias) in enumerate(zip(mlp.weights, mlp.biases, strict=True)):
        y = y @ np.asarray(weight, np.float64) + np.asarray(bias, np.float64)
        if i < 2:
            y = np.where(y > 0, y, np.exp(np.minimum(y, 0)) - 1.0)
    np.testing.assert_allclose(forward(mlp, jnp.asarray(x, jnp.float32)), y, rtol=1e-5, atol=1e-5)


def test_elu_and_its_slope():
    x = np.array([-200.0, -20.0, -1.0, -1e-3, 0.0, 1e-3, 1.0, 200.0])
    y, slope = jax.vmap(jax.value_and_grad(elu))(jnp.asarray(x, jnp.float32))
    np.testing.assert_allclose(
        y, np.where(x > 0, x, np.expm1(np.minimum(x, 0))), rtol=1e-6, atol=1e-7
    )
    np.testing.assert_allclose(slope, np.exp(np.minimum(x, 0)), rtol=1e-6, atol=1e-7)


def test_elu_is_as_exact_as_float32_below_zero():
    x = np.concatenate([np.linspace(-100.0, 0.0, 100_001), -np.logspace(-37, 2, 100_001)]).astype(
        np.float32
    )
    expected = np.expm1(x.astype(np.float64))
    for evaluate in (elu, jax.jit(elu)):  # compiled, products and sums are fused
        np.testing.assert_allclose(
            np.asarray(evaluate(jnp.asarray(x)), np.float64), expected, rtol=1e-7, atol=0
        )


def test_elu_hides_nothing_that_is_not_finite():
    y, slope = jax.jit(jax.vmap(jax.value_and_grad(elu)))(jnp.asarray([np.nan, np.inf, -np.inf]))
    assert np.isnan(y[0]) and np.isnan(slope[0]) and y[1:].tolist() == [np.inf, -1.0]


def test_log_probability_and_entropy_are_those_of_scipy():
    rng = np.random.default_rng(1)
    action, mean = rng.normal(size=(2, 7, 3, 4)) * 2.0
    log_std = np.array([-3.0, -0.5, 0.0, 1.5])
    expected = stats.norm.logpdf(action, mean, np.exp(log_std)).sum(-1)
    result = gaussian_log_prob(*(jnp.asarray(x, jnp.float32) for x in (action, mean, log_std)))
    np.testing.assert_allclose(result, expected, rtol=2e-5)
    expected = [stats.norm(0.0, np.exp(s)).entropy() for s in log_std]
    np.testing.assert_allclose(
        gaussian_entropy(jnp.asarray(log_std, jnp.float32)), expected, rtol=1e-5
    )


def test_log_std_is_kept_in_its_bounds():
    parameters = PARAMETERS.replace(log_std=jnp.asarray([-30.0, -20.0, 1.0, 5.0]))
    assert project_log_std(parameters, LEARN).log_std.tolist() == [-20.0, -20.0, 1.0, 2.0]
    narrow = replace(LEARN, min_log_std=-1.0, max_log_std=0.0)
    assert project_log_std(parameters, narrow).log_std.tolist() == [-1.0, -1.0, 0.0, 0.0]
