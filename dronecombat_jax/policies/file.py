"""One policy as one file to share: what it holds, how it is written, and what is refused on the way
in.

A file opens without JAX and never runs code. The format and its names: `docs/policies.md`; to fly
one with NumPy alone: `numpy_policy`. What does not live here: the container (`tensorfile`), the
metadata (`policy_info`), getting a policy out of a run (`export`).
"""

import itertools
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dronecombat_jax.combat.fingerprint import environment, game_diff
from dronecombat_jax.combat.sight import GROUPS, SLOT_SIZE
from dronecombat_jax.config.fields import Config, LearnConfig
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.errors import EXIT_CANNOT_WRITE, EXIT_CONFIG, EXIT_DATA, UserError
from dronecombat_jax.files import tensorfile
from dronecombat_jax.files.arrays import nonfinite
from dronecombat_jax.files.atomic import write_atomic
from dronecombat_jax.files.tensorfile import PolicyError, digest_of
from dronecombat_jax.learn.recurrent import GATES
from dronecombat_jax.policies.info import NO_MEMORY, PolicyInfo, info_of, metadata_of
from dronecombat_jax.types import GRU, MLP, Encoder, Policy, Scaler, SidePolicy, TeamPolicy

MAX_NAME_BYTES = 200  # a file system takes 255, and the temporary name beside it is longer
_MAX_NAMED = 5
GRU_PARTS = ("weights", "state_weights", "biases", "candidate_bias")  # of `types.GRU`, in its order


class SavedPolicy(NamedTuple):
    """A side's policy as read from a file; NumPy leaves."""

    policy: SidePolicy
    info: PolicyInfo


def save_policy(path: Path, policy: SidePolicy, info: PolicyInfo, *, force: bool = False) -> None:
    """Write a side's policy (leaves without leading axes) to `path`, whole or not at all; equal
    input, equal bytes.

    Raises UserError 73 where `path` exists (without `force`) or the disk refuses, PolicyError for
    NaN or infinity and for arrays that are not those of `info.layer_sizes`.
    """
    refuse_overwriting(path, force)
    tensors = tensors_of(policy)
    if fault := _misfit(tensors, info) or _bad_numbers(tensors):
        raise PolicyError(path, f"not written: {fault}")
    metadata = metadata_of(info)
    write_atomic(
        path, tensorfile.encode(tensors, {**metadata, "sha256": digest_of(tensors, metadata)})
    )


def load_policy(path: Path) -> SavedPolicy:
    """Read and check a policy file.

    Raises PolicyError (exit 3): one line that says what is wrong with it.
    """
    tensors, metadata = tensorfile.read(path)
    try:
        info = info_of(metadata)
    except (ValueError, RecursionError) as error:
        raise PolicyError(path, str(error)) from None
    if fault := _misfit(tensors, info) or _bad_numbers(tensors):
        raise PolicyError(path, fault)
    claimed = metadata.pop("sha256", "")
    if claimed != digest_of(tensors, metadata):
        raise PolicyError(path, "damaged: its sha256 does not match its content")
    return SavedPolicy(_side(tensors, info), info)


def refuse_overwriting(path: Path, force: bool) -> None:
    """Raise UserError 73 where something is at `path` already; with `force` a link is replaced,
    never followed.
    """
    if len(os.fsencode(path.name)) > MAX_NAME_BYTES:
        raise UserError(
            f"the file name {one_line(path.name)} is longer than {MAX_NAME_BYTES} bytes",
            EXIT_CANNOT_WRITE,
        )
    if os.path.lexists(path) and not force:
        raise UserError(f"{path} is there already; --force replaces it", EXIT_CANNOT_WRITE)


def refuse_more_than_layers(path: Path, info: PolicyInfo) -> None:
    """Raise UserError 2 for a policy with memory or an encoder of others: a policy file alone holds it."""
    more = f"memory ({info.memory})" if info.memory != NO_MEMORY else ""
    if more or info.others_size:
        raise UserError(
            f"{one_line(path.name)}: a policy with {more or 'learn.others = mean'} is exported as .safetensors alone",
            EXIT_CONFIG,
        )


def require_environment(
    info: PolicyInfo, config: Config, *, allow_mismatch: bool = False
) -> list[str]:
    """How the game that a policy was trained in differs from that of `config`; one line each, none
    where equal.

    Another observation of the package than the game's is no difference: whoever flies the policy
    shows it what it saw in its training (`fingerprint.own_view`). Raises UserError 3 that names the
    first five differences, unless they are allowed. A policy that wants other scaling of its observations than `config.learn` is refused in any case: it would fly
    blindly.
    """
    if info.normalize_observations != config.learn.normalize_observations:
        wanted = str(info.normalize_observations).lower()
        raise UserError(
            f"policy of {info.run}: it needs learn.normalize_observations = {wanted}", EXIT_DATA
        )
    lines = [
        one_line(line) for line in game_diff(info.environment, environment(config), config.game)
    ]
    if lines and not allow_mismatch:
        more = f"; and {len(lines) - _MAX_NAMED} more" if len(lines) > _MAX_NAMED else ""
        listed = "; ".join(lines[:_MAX_NAMED])
        raise UserError(
            f"policy of {info.run} was trained in another game: {listed}{more}", EXIT_DATA
        )
    return lines


def as_flown(policy: Policy, learn: LearnConfig) -> Policy:
    """The policy of a run as the run flies it, with its log-std in the bounds of `learn`.

    Only its run knows the bounds; in older checkpoints the parameter may lie outside.
    """
    bounded = np.clip(policy.log_std, learn.least_log_std, learn.max_log_std).astype(np.float32)
    return policy.replace(log_std=bounded)


def tensors_of(policy: SidePolicy) -> dict[str, np.ndarray]:
    """The arrays of a side's policy by their names in the file; of policies of team mates each with
    one axis more, the first.
    """
    if isinstance(policy, TeamPolicy):
        each = [tensors_of(mate) for mate in policy.mates]
        return {name: np.stack([arrays[name] for arrays in each]) for name in each[0]}
    network, scaler = policy.network, policy.observation_scaler
    arrays = {
        **{f"weights.{i}": weight for i, weight in enumerate(network.weights)},
        **{f"biases.{i}": bias for i, bias in enumerate(network.biases)},
        "log_std": policy.log_std,
        "observation_mean": scaler.mean,
        "observation_variance": scaler.variance,
        "observation_count": scaler.count,
    }
    if network.others is not None:
        arrays |= {"others_weights": network.others.weights, "others_biases": network.others.biases}
    if policy.gru is not None:
        arrays |= {f"gru_{name}": getattr(policy.gru, name) for name in GRU_PARTS}
    return {name: np.asarray(array) for name, array in arrays.items()}


def _side(tensors: dict[str, np.ndarray], info: PolicyInfo) -> SidePolicy:
    layers = len(info.layer_sizes) - 1
    if info.mates == 1:
        return _policy(tensors, layers)
    of = lambda number: {name: np.asarray(array[number]) for name, array in tensors.items()}
    return TeamPolicy(tuple(_policy(of(number), layers) for number in range(info.mates)))


def _policy(tensors: dict[str, np.ndarray], layers: int) -> Policy:
    each = lambda name: tuple(tensors[f"{name}.{i}"] for i in range(layers))
    scaler = Scaler(*(tensors[f"observation_{part}"] for part in ("mean", "variance", "count")))  # pyright: ignore
    others = None
    if "others_weights" in tensors:
        others = Encoder(tensors["others_weights"], tensors["others_biases"])  # pyright: ignore
    network = MLP(each("weights"), each("biases"), others)  # pyright: ignore
    gru = None
    if f"gru_{GRU_PARTS[0]}" in tensors:
        gru = GRU(*(tensors[f"gru_{name}"] for name in GRU_PARTS))  # pyright: ignore
    return Policy(network, tensors["log_std"], scaler, gru)  # pyright: ignore


def _misfit(tensors: dict[str, np.ndarray], info: PolicyInfo) -> str:
    """The first arrays whose dtype or shape is not that of a policy of `info.layer_sizes`; empty
    where all fit.
    """
    sizes = info.layer_sizes
    layers = list(itertools.pairwise((info.first_inputs, *sizes[1:])))
    expected: dict[str, tuple[int, ...]] = {
        **{f"weights.{i}": layer for i, layer in enumerate(layers)},
        **{f"biases.{i}": layer[1:] for i, layer in enumerate(layers)},
        "log_std": sizes[-1:],
        "observation_mean": sizes[:1],
        "observation_variance": sizes[:1],
        "observation_count": (),
        **_encoder_shapes(info.others_size),
        **_gru_shapes(sizes[0], info.gru_size),
    }
    lead = (info.mates,) if info.mates > 1 else ()
    spelt = lambda dtype, shape: f"{dtype}[{','.join(map(str, shape))}]"
    wanted = {name: spelt("float32", (*lead, *shape)) for name, shape in expected.items()}
    given = {name: spelt(array.dtype.name, array.shape) for name, array in tensors.items()}
    wrong = [
        f"{name}: expected {wanted.get(name, 'nothing')}, got {given.get(name, 'nothing')}"
        for name in [*wanted, *sorted(given.keys() - wanted.keys())]
        if wanted.get(name) != given.get(name)
    ]
    more = f"; and {len(wrong) - _MAX_NAMED} more" if len(wrong) > _MAX_NAMED else ""
    return (
        f"its arrays are not those of layer_sizes: {'; '.join(wrong[:_MAX_NAMED])}{more}"
        if wrong
        else ""
    )


def _encoder_shapes(size: int) -> dict[str, tuple[int, ...]]:
    """Shapes of the arrays of an encoder of `size` units by their names; of none where it is 0."""
    groups = len(GROUPS)
    shapes = {"others_weights": (groups, SLOT_SIZE - 1, size), "others_biases": (groups, size)}
    return shapes if size else {}


def _gru_shapes(seen: int, size: int) -> dict[str, tuple[int, ...]]:
    """Of the arrays of a GRU with a state of `size` numbers; none where it has none."""
    shapes = (seen, GATES * size), (size, GATES * size), (GATES * size,), (size,)
    return {f"gru_{name}": shape for name, shape in zip(GRU_PARTS, shapes, strict=True) if size}


def _bad_numbers(tensors: dict[str, np.ndarray]) -> str:
    """Why these arrays cannot fly; empty where they can."""
    if wrong := nonfinite(tensors):
        return f"NaN or infinity in {wrong}"
    return (
        "observation_variance is negative" if np.any(tensors["observation_variance"] < 0.0) else ""
    )
