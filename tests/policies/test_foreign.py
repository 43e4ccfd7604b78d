"""A network of another library as a policy file."""

import itertools

import numpy as np
import pytest

from dronecombat_jax.config.fields import Config
from dronecombat_jax.errors import UserError
from dronecombat_jax.policies.file import load_policy
from dronecombat_jax.policies.foreign import save_network
from dronecombat_jax.policies.numpy_policy import NumpyPolicy


def network(*sizes: int, seed: int = 0) -> tuple[list[np.ndarray], list[np.ndarray]]:
    draw = np.random.default_rng(seed).normal
    pairs = list(itertools.pairwise(sizes))
    return [draw(size=pair) / pair[0] for pair in pairs], [draw(size=pair[1]) for pair in pairs]


def elu(x: np.ndarray) -> np.ndarray:
    return np.where(x > 0, x, np.exp(np.minimum(x, 0)) - 1)


@pytest.mark.parametrize("scaled", [False, True])
def test_the_file_flies_what_the_network_computes(tmp_path, scaled):
    weights, biases = network(35, 11, 7, 4)
    draw = np.random.default_rng(1)
    scaler = {"mean": draw.normal(size=35), "variance": draw.uniform(0.5, 2, 35)} if scaled else {}
    path = save_network(
        tmp_path / "mine.safetensors", "defender", Config(), weights, biases, **scaler, steps=7
    )
    x = draw.normal(size=35)
    seen = np.clip((x - scaler["mean"]) / np.sqrt(scaler["variance"]), -5, 5) if scaled else x
    for weight, bias in zip(weights[:-1], biases[:-1], strict=True):
        seen = elu(seen @ weight + bias)
    expected = seen @ weights[-1] + biases[-1]
    np.testing.assert_allclose(NumpyPolicy(path)(x), expected, atol=1e-6)
    info = load_policy(path).info
    assert info.layer_sizes == (35, 11, 7, 4) and info.role == "defender" and info.steps == 7


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"role": "referee"}, "role referee: defender or attacker is allowed"),
        ({"mean": np.zeros(35)}, "mean and variance: give both or none"),
        ({"mean": np.zeros(34), "variance": np.ones(34)}, "observation_mean: expected float32[35]"),
        ({"weights": network(36, 11, 4)[0]}, "weights.0: expected float32[35,11]"),
        ({"weights": network(35, 12, 4)[0]}, "weights.0: expected float32[35,11]"),
        ({"log_std": np.full(4, np.nan)}, "NaN or infinity in log_std"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(tmp_path, change, said):
    weights, biases = network(35, 11, 4)
    given = {"role": "attacker", "weights": weights, "biases": biases} | change
    path = tmp_path / "mine.safetensors"
    with pytest.raises(UserError) as refused:
        save_network(path, given.pop("role"), Config(), **given)
    assert said in refused.value.message and "\n" not in refused.value.message
    assert not path.exists()


def test_a_file_that_is_there_is_not_overwritten_unless_asked(tmp_path):
    weights, biases = network(35, 11, 4)
    path = save_network(tmp_path / "mine.safetensors", "attacker", Config(), weights, biases)
    with pytest.raises(UserError, match="there already"):
        save_network(path, "attacker", Config(), weights, biases)
    save_network(path, "attacker", Config(), weights, biases, force=True)
