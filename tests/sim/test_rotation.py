"""Quaternions against scipy's Rotation."""

import numpy as np
from scipy.spatial.transform import Rotation

from dronecombat_jax.sim.rotation import body_z, conjugate, multiply, rotate, rotate_inverse

# First the ones that betray a swapped sign or order: identity, half and quarter turns.
TURNS = Rotation.concatenate(
    [
        Rotation.identity(),
        Rotation.from_euler("x", 180, degrees=True),
        Rotation.from_euler("y", 90, degrees=True),
        Rotation.from_euler("z", -90, degrees=True),
        Rotation.random(60, np.random.default_rng(0)),
    ]
)
OTHER = Rotation.random(len(TURNS), np.random.default_rng(1))
VECTORS = np.random.default_rng(2).normal(size=(len(TURNS), 3)).astype(np.float32)


def wxyz(turns: Rotation) -> np.ndarray:
    return turns.as_quat(scalar_first=True).astype(np.float32)


def test_rotations_agree_with_scipy():
    quaternion = wxyz(TURNS)
    np.testing.assert_allclose(rotate(quaternion, VECTORS), TURNS.apply(VECTORS), atol=2e-6)
    np.testing.assert_allclose(
        rotate_inverse(quaternion, VECTORS), TURNS.inv().apply(VECTORS), atol=2e-6
    )
    np.testing.assert_allclose(body_z(quaternion), TURNS.as_matrix()[..., 2], atol=2e-6)


def test_product_turns_by_the_right_factor_first():
    product = multiply(wxyz(TURNS), wxyz(OTHER))
    np.testing.assert_allclose(
        rotate(product, VECTORS), TURNS.apply(OTHER.apply(VECTORS)), atol=2e-6
    )
    unit = np.tile(np.array([1, 0, 0, 0], np.float32), (len(TURNS), 1))
    np.testing.assert_allclose(multiply(wxyz(TURNS), conjugate(wxyz(TURNS))), unit, atol=2e-6)


def test_leading_axes_are_free():
    turns, vectors = wxyz(TURNS).reshape(2, -1, 4), VECTORS.reshape(2, -1, 3)
    np.testing.assert_allclose(
        rotate(turns, vectors).reshape(-1, 3), rotate(wxyz(TURNS), VECTORS), atol=1e-6
    )
    # one turn, many vectors
    np.testing.assert_allclose(rotate(turns[0, 0], vectors), vectors, atol=1e-6)
