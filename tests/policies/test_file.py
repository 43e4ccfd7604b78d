"""A policy comes back from its file bit for bit, flies the same without JAX, and is refused when
anything is off.
"""

import hashlib
import json
import math
from pathlib import Path

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from policies import SIZES, make_info, make_policy
from policy_files import write

from dronecombat_jax.combat.fingerprint import environment_digest
from dronecombat_jax.config.fields import Config, GameConfig, LearnConfig, SimConfig
from dronecombat_jax.errors import EXIT_CANNOT_WRITE, EXIT_DATA, UserError
from dronecombat_jax.files import tensorfile
from dronecombat_jax.files.tensorfile import PolicyError
from dronecombat_jax.learn.mates import only
from dronecombat_jax.learn.rollout import policy_mean
from dronecombat_jax.policies.file import (
    load_policy,
    require_environment,
    save_policy,
    tensors_of,
)
from dronecombat_jax.policies.numpy_policy import NumpyPolicy

# The mean action of the golden file for np.linspace(-20, 20, 35), by `slow_mean` when it was made.
EXPECTED = [0.07421450221145705, -0.06840864478104705, 0.21570730780416705, -0.005350446433369578]
GOLDEN = Path(__file__).parents[1] / "golden" / "policy_v1.safetensors"


def same_bits(a, b) -> bool:
    pairs = zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    return all(np.asarray(x).tobytes() == np.asarray(y).tobytes() for x, y in pairs)


def refusal(path: Path) -> str:
    with pytest.raises(PolicyError) as error:
        load_policy(path)
    message = error.value.message
    assert (
        error.value.exit_code == EXIT_DATA
        and message.startswith(f"{path}: ")
        and message.isprintable()
    )
    return message.removeprefix(f"{path}: ")


# saving and loading


def test_it_comes_back_bit_for_bit(path):
    policy, info = (
        make_policy(),
        make_info(Config(sim=SimConfig(substeps=3), game=GameConfig(observation="ego"))),
    )
    save_policy(path, policy, info)
    loaded = load_policy(path)
    assert same_bits(loaded.policy, policy) and jax.tree.structure(
        loaded.policy
    ) == jax.tree.structure(policy)
    assert loaded.info == info and loaded.info.observation == "ego"
    assert loaded.info.control_dt == pytest.approx(0.03)
    first = path.read_bytes()
    save_policy(path, policy, info, force=True)
    assert path.read_bytes() == first  # neither time nor order of a hash
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]


def test_everything_is_said_in_text(path):
    save_policy(path, make_policy(), make_info())
    _, metadata = tensorfile.read(path)
    assert metadata["environment_sha256"] == environment_digest(Config())
    assert (
        hashlib.sha256(metadata["environment"].encode()).hexdigest()
        == metadata["environment_sha256"]
    )
    assert json.loads(metadata["layer_sizes"]) == list(SIZES)
    assert sum(size for _, size in json.loads(metadata["observation_fields"])) == 35
    assert (metadata["control_dt"], metadata["normalization_clip"], metadata["activation"]) == (
        "0.02",
        "5.0",
        "elu",
    )
    assert (metadata["run"], metadata["seed"], metadata["chunk"], metadata["steps"]) == (
        "ippo-laptop",
        "3",
        "12",
        "1200000",
    )


def test_a_file_that_is_there_stays_as_it_is(path):
    path.write_text("mine")
    link = path.with_name("link.safetensors")
    link.symlink_to(path)
    for target in (path, link):
        with pytest.raises(UserError, match="is there already; --force replaces it") as error:
            save_policy(target, make_policy(), make_info())
        assert error.value.exit_code == EXIT_CANNOT_WRITE
    save_policy(link, make_policy(), make_info(), force=True)
    assert path.read_text() == "mine" and not link.is_symlink()
    load_policy(link)


def test_what_cannot_fly_is_not_written(path):
    broken = make_policy()
    broken.network.weights[0][3, 4] = np.nan
    with pytest.raises(
        PolicyError, match=r"not written: NaN or infinity in weights.0 \(1 of 560\)"
    ):
        save_policy(path, broken, make_info())
    with pytest.raises(PolicyError, match=r"log_std: expected float32\[4\], got float64\[4\]"):
        save_policy(path, make_policy().replace(log_std=np.zeros(4)), make_info())
    assert not path.exists()


# refusals


def test_other_network_sizes_are_named(path):
    message = refusal(write(path, metadata={"layer_sizes": "[35, 256, 128, 4]"}))
    assert "weights.0: expected float32[35,256], got float32[35,16]" in message
    assert message.endswith("biases.0: expected float32[256], got float32[16]; biases.1: expected float32[128], "
                            "got float32[8]")  # fmt: skip


@pytest.mark.parametrize(
    ("tensors", "words"),
    [
        ({"log_std": None}, "log_std: expected float32[4], got nothing"),
        ({"value.0": np.zeros(3, np.float32)}, "value.0: expected nothing, got float32[3]"),
        (
            {"weights.1": np.zeros((8, 16), np.float32)},
            "weights.1: expected float32[16,8], got float32[8,16]",
        ),
        (
            {"log_std": np.zeros((4, 1), np.float32)},
            "log_std: expected float32[4], got float32[4,1]",
        ),
        ({"biases.0": np.full(16, np.nan, np.float32)}, "NaN or infinity in biases.0 (16 of 16)"),
        (
            {"observation_mean": np.full(35, np.inf, np.float32)},
            "NaN or infinity in observation_mean",
        ),
        ({"observation_variance": np.full(35, -1, np.float32)}, "observation_variance is negative"),
    ],
)
def test_arrays_that_cannot_fly(path, tensors, words):
    assert words in refusal(write(path, tensors))


@pytest.mark.parametrize(
    ("metadata", "words"),
    [
        ({"format": None}, "no policy of dronecombat"),
        ({"format": "pt"}, "no policy of dronecombat"),
        (
            {"format_version": "4"},
            "it has format 4, this version reads up to 3: upgrade dronecombat-jax",
        ),
        ({"format_version": "2"}, "metadata memory is missing: expected frames"),
        ({"format_version": "2", "memory": "none"}, "metadata memory is none: expected frames"),
        ({"format_version": "2", "memory": "frames 65"}, "metadata memory is frames 65"),
        (
            {"format_version": "2", "memory": "frames 3"},
            "weights.0: expected float32[105,16], got float32[35,16]",
        ),
        ({"format_version": "0"}, "metadata format_version is 0: expected 1"),
        ({"format_version": "-1"}, "metadata format_version is -1"),
        ({"format_version": "9" * 5000}, "metadata format_version is 999"),
        ({"role": "referee"}, "metadata role is referee: expected defender|attacker"),
        ({"activation": "relu"}, "metadata activation is relu: expected elu"),
        ({"observation": "ego"}, "metadata observation is ego: expected world"),
        ({"observation_fields": '[["p_a", 35]]'}, "metadata observation_fields is"),
        ({"normalize_observations": "yes"}, "metadata normalize_observations is yes"),
        ({"normalization_clip": "10.0"}, "metadata normalization_clip is 10.0: expected 5.0"),
        (
            {"normalization_epsilon": "1e-05"},
            "metadata normalization_epsilon is 1e-05: expected 1e-08",
        ),
        ({"control_dt": "0.01"}, "metadata control_dt is 0.01: expected 0.02"),
        ({"layer_sizes": "[35, 4]"}, "metadata layer_sizes is [35, 4]"),
        ({"layer_sizes": "[36, 16, 8, 4]"}, "metadata layer_sizes is [36, 16, 8, 4]"),
        (
            {"layer_sizes": "[35, 1000000000000, 4]"},
            "metadata layer_sizes is [35, 1000000000000, 4]",
        ),
        ({"layer_sizes": "[35" + ", 8" * 10_000 + ", 4]"}, "metadata layer_sizes is [35, 8"),
        ({"layer_sizes": "[" * 50_000}, "recursion"),
        ({"environment": "[]"}, "metadata environment is []: expected an object"),
        ({"environment": "{}"}, "sim.timestep"),
        ({"environment_sha256": "0" * 64}, "metadata environment_sha256 is 000"),
        ({"run": "a\nerror: b"}, "metadata run is a?error: b"),
        ({"run": "=HYPERLINK(1)"}, "metadata run is =HYPERLINK(1)"),
        ({"run": "r" * 300}, "metadata run is rrr"),
        ({"jax_version": ""}, "metadata jax_version is"),
        ({"seed": "1.5"}, "metadata seed is 1.5"),
        ({"steps": None}, "metadata steps is missing"),
        ({"sha256": "0" * 64}, "its sha256 does not match its content"),
    ],
)
def test_metadata_that_do_not_hold(path, metadata, words):
    message = refusal(write(path, metadata=metadata))
    assert words in message and len(message) < 600


def test_further_metadata_are_welcome(path):
    assert load_policy(write(path, metadata={"title": "the red one"})).info == make_info()


@given(
    place=st.floats(0, 1, exclude_max=True),
    byte=st.integers(0, 255),
    kind=st.sampled_from(["flip", "drop", "add"]),
)
@settings(max_examples=150, deadline=None)
def test_any_changed_byte_is_noticed(tmp_path_factory, place, byte, kind):
    path = tmp_path_factory.getbasetemp() / "flipped.safetensors"
    whole = write(path).read_bytes()
    at = int(place * len(whole))
    middle = {"flip": bytes([byte]), "drop": b"", "add": whole[at : at + 1] + bytes([byte])}[kind]
    path.write_bytes(whole[:at] + middle + whole[at + 1 :])
    try:
        loaded = load_policy(path)
    except PolicyError as error:
        assert error.message.isprintable()
    else:
        assert same_bits(loaded.policy, make_policy()) and loaded.info == make_info()


# other games


def test_a_policy_of_another_game_is_refused_and_the_difference_named():
    info = make_info(Config(game=GameConfig(intercept_radius=0.1), sim=SimConfig(body="p250")))
    with pytest.raises(UserError) as error:
        require_environment(info, Config())
    assert error.value.exit_code == EXIT_DATA
    assert error.value.message == (
        "policy of ippo-laptop was trained in another game: game.intercept_radius is 0.1 there, 0.5 here; "
        'sim.body is "p250" there, "isaac" here'
    )
    assert len(require_environment(info, Config(), allow_mismatch=True)) == 2
    assert require_environment(make_info(), Config(game=GameConfig(random_clock=False))) == []


def test_scaled_observations_are_not_left_to_chance():
    with pytest.raises(UserError, match=r"it needs learn\.normalize_observations = false"):
        require_environment(make_info(normalize_observations=False), Config(), allow_mismatch=True)


# without JAX


# files of earlier releases


def slow_mean(tensors: dict[str, np.ndarray], observation: np.ndarray) -> list[float]:
    """The policy as loops over Python numbers."""
    columns = (
        each.tolist()
        for each in (observation, tensors["observation_mean"], tensors["observation_variance"])
    )
    x = [
        max(-5.0, min(5.0, (o - m) / (math.sqrt(v) + 1e-8)))
        for o, m, v in zip(*columns, strict=True)
    ]
    for layer in range(3):
        weight, bias = tensors[f"weights.{layer}"], tensors[f"biases.{layer}"]
        x = [
            sum(a * float(weight[i, j]) for i, a in enumerate(x)) + float(bias[j])
            for j in range(len(bias))
        ]
        x = x if layer == 2 else [a if a > 0 else math.expm1(a) for a in x]
    return x


def test_a_file_of_format_1_still_flies():
    """Made by `save_policy(path, make_policy(SIZES, seed=0), make_info())` when format 1 was young."""
    loaded = load_policy(GOLDEN)
    assert (loaded.info.run, loaded.info.layer_sizes, loaded.info.observation) == (
        "ippo-laptop",
        SIZES,
        "world",
    )
    seen = np.linspace(-20.0, 20.0, 35).astype(np.float32)
    expected = slow_mean(tensors_of(loaded.policy), seen)
    assert NumpyPolicy(GOLDEN)(seen) == pytest.approx(expected, abs=1e-6)
    assert np.asarray(policy_mean(LearnConfig(), only(loaded.policy, "it"), seen)) == pytest.approx(
        expected, abs=1e-6
    )
    assert expected == pytest.approx(EXPECTED, abs=1e-9)
