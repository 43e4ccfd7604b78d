"""Policies that nobody trained, and what a file says about them; shared by the tests of files and
exports.
"""

import itertools
from typing import Any

import numpy as np

from dronecombat_jax.combat.fingerprint import environment
from dronecombat_jax.config.fields import Config
from dronecombat_jax.policies.info import PolicyInfo
from dronecombat_jax.types import GRU, MLP, Policy, Scaler

SIZES = (35, 16, 8, 4)


def make_policy(
    sizes: tuple[int, ...] = SIZES, seed: int = 0, frames: int = 1, state: int = 0
) -> Policy:
    """Weights that keep the size of what goes through them, a last layer that makes actions that a
    drone can fly, and a scaler far from mean 0 and variance 1. It sees its last `frames`
    observations, `sizes[0]` numbers in all; or one, and a GRU's `state` numbers.
    """
    rng = np.random.default_rng(seed)
    draw = lambda *shape: rng.standard_normal(shape, np.float32)
    weights = tuple(draw(a, b) * np.float32(a**-0.5) for a, b in itertools.pairwise(sizes))
    weights[-1][:] *= np.float32(0.05)
    biases = tuple(draw(size) / 8 for size in sizes[1:])
    seen = (sizes[0] - state) // frames
    variance = np.float32(10.0) ** draw(seen)
    scaler = Scaler(3 * draw(seen), variance, np.float32(1e6))
    log_std = draw(sizes[-1])
    shapes = (seen, 3 * state), (state, 3 * state), (3 * state,), (state,)
    gru = GRU(*(draw(*shape) / 4 for shape in shapes)) if state else None
    return Policy(MLP(weights, biases), log_std, scaler, gru)


def make_info(config: Config | None = None, **changes: Any) -> PolicyInfo:
    info = PolicyInfo(
        role="attacker",
        layer_sizes=SIZES,
        normalize_observations=True,
        environment=environment(config or Config()),
        run="ippo-laptop",
        seed=3,
        chunk=12,
        steps=1_200_000,
        package_version="0.1.0",
        jax_version="0.12.0.1",
        config_sha256="0" * 64,
    )
    return info._replace(**changes)


def observations(policy: Policy, spread: float, normalize: bool = True) -> np.ndarray:
    """[256, 35], `spread` standard deviations around what the policy has seen; around 0 if it does
    not normalise.
    """
    scaler = policy.observation_scaler
    drawn = spread * np.random.default_rng(1).standard_normal((256, scaler.mean.size))
    return np.asarray(
        scaler.mean + np.sqrt(scaler.variance) * drawn if normalize else drawn, np.float32
    )


def assert_same_actions(a: np.ndarray, b: np.ndarray) -> None:
    """Equal to 1e-6, and numbers that a drone can fly: of an action of 30 float32 knows no more
    than 2e-6.
    """
    assert a.shape == b.shape and np.abs(a - b).max() <= 1e-6, np.abs(a - b).max()
    assert 0.05 < np.abs(b).max() < 3.0
