"""The running scaler against skrl 1.4.3's RunningStandardScaler (golden file) and against NumPy."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from dronecombat_jax.learn.normalize import denormalize, init_scaler, normalize, update_scaler
from dronecombat_jax.types import Scaler

GOLDEN = np.load(Path(__file__).parents[1] / "golden" / "skrl_update.npz", allow_pickle=False)


def test_four_batches_agree_with_skrl():
    golden = {name: GOLDEN[name] for name in GOLDEN.files if name.startswith("scaler/float32/")}
    probe = jnp.asarray(golden["scaler/float32/probe"])
    scaler = init_scaler((3,))
    for k in range(4):
        after = {
            name: golden[f"scaler/float32/{k}/{name}"] for name in ("mean", "variance", "count")
        }
        batch = jnp.asarray(golden[f"scaler/float32/{k}/input"])
        scaler = update_scaler(scaler, batch, jnp.ones(batch.shape[:-1]))
        np.testing.assert_allclose(scaler.mean, after["mean"], rtol=1e-6)
        np.testing.assert_allclose(scaler.variance, after["variance"], rtol=2e-6)
        assert scaler.count == after["count"]
        output = normalize(scaler, jnp.asarray(golden[f"scaler/float32/{k}/input"]))
        np.testing.assert_allclose(
            output, golden[f"scaler/float32/{k}/output"], rtol=2e-5, atol=2e-6
        )
        # Terms nearly cancel, as in 30.61804 - 29.70065: float32 knows 30.6 to 1.9e-6 alone, and
        # skrl's own result is 7e-7 away from what its mean and variance give in float64.
        inverse = golden[f"scaler/float32/{k}/inverse"]
        np.testing.assert_allclose(denormalize(scaler, probe), inverse, rtol=2e-6, atol=2e-6)


def test_many_batches_agree_with_numpy():
    rng = np.random.default_rng(0)
    data = rng.normal([3.0, -40.0], [0.1, 25.0], (50, 20, 30, 2)).astype(np.float32)
    scaler = init_scaler((2,))
    for batch in data:
        scaler = update_scaler(scaler, jnp.asarray(batch), jnp.ones(batch.shape[:-1]))
    flat = data.reshape(-1, 2).astype(np.float64)
    # The start counts as one sample of mean 0: the mean of n numbers is their sum / (n + 1).
    np.testing.assert_allclose(scaler.mean, flat.sum(0) / (len(flat) + 1), rtol=1e-5)
    # that sample weighs on a small variance
    np.testing.assert_allclose(scaler.variance, flat.var(0), rtol=0.05)
    assert scaler.count == len(flat) + 1


def test_a_scaler_of_single_numbers_takes_any_leading_axes():
    batch = jnp.asarray(np.random.default_rng(1).normal(size=(6, 4)), jnp.float32)
    table, row = (
        update_scaler(init_scaler(()), batch, jnp.ones(batch.shape)),
        update_scaler(init_scaler(()), batch.reshape(-1), jnp.ones(batch.size)),
    )
    assert table.mean.shape == () and table.count == 25
    np.testing.assert_allclose(table.mean, row.mean, rtol=1e-6)
    np.testing.assert_allclose(table.variance, row.variance, rtol=1e-6)


def test_scaling_is_clipped_at_five_and_undone():
    scaler = Scaler(jnp.asarray([10.0]), jnp.asarray([4.0]), jnp.asarray(9.0))
    x = jnp.asarray([[10.0], [12.0], [0.0], [1e6], [-1e6]])
    assert normalize(scaler, x)[:, 0].tolist() == [0.0, 1.0, -5.0, 5.0, -5.0]
    assert denormalize(scaler, jnp.asarray([[0.0], [1.0], [7.0], [-7.0]]))[:, 0].tolist() == [
        10.0,
        12.0,
        20.0,
        0.0,
    ]
    inside = jnp.linspace(1.0, 19.0, 7)[:, None]
    np.testing.assert_allclose(denormalize(scaler, normalize(scaler, inside)), inside, rtol=1e-5)


def test_a_constant_input_stays_finite():
    scaler = init_scaler((2,))
    for _ in range(100):
        scaler = update_scaler(scaler, jnp.full((500, 2), 7.0), jnp.ones(500))
    scaled = normalize(scaler, jnp.full((2,), 7.0))
    assert np.all(np.isfinite(scaled)) and np.all(np.abs(scaled) <= 5.0)


@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf])
def test_a_batch_that_is_not_finite_is_left_out(poison):
    before = update_scaler(init_scaler(()), jnp.arange(8.0), jnp.ones(8))
    after = update_scaler(before, jnp.arange(8.0).at[3].set(poison), jnp.ones(8))
    assert (after.mean, after.variance, after.count) == (before.mean, before.variance, before.count)
