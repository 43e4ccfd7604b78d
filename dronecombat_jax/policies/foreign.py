"""A network that another library trained as a policy file: it then flies, fights and is rated like ours.

    save_network("mine.safetensors", "attacker", config, weights, biases)

What does not live here: the file itself (`file`), training.
"""

import hashlib
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from dronecombat_jax.combat.fingerprint import environment
from dronecombat_jax.combat.observe import observation_of
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.settings import to_toml
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.files.versions import package_version
from dronecombat_jax.policies.file import save_policy
from dronecombat_jax.policies.info import PolicyInfo
from dronecombat_jax.types import ACTION_SIZE, MLP, SIDES, Policy, Scaler


def save_network(
    path: str | Path,
    role: str,
    config: Config,
    weights: Sequence[Any],
    biases: Sequence[Any],
    *,
    log_std: Any = None,
    mean: Any = None,
    variance: Any = None,
    name: str = "foreign",
    seed: int = 0,
    steps: int = 0,
    force: bool = False,
) -> Path:
    """Write the policy network of `role`, trained in the game of `config`, to the file `path`.

    `weights[i]` [in, out] and `biases[i]` [out] lead from the observation [35] to the mean action
    [4]; between layers stands ELU, after the last nothing: the game clips actions to [-1, 1].
    PyTorch's `Linear.weight` is [out, in]: transpose it. `log_std` [4]: of the drawn actions, 0
    without it. `mean` and `variance` [35]: the network sees (x - mean) / (sqrt(variance) + 1e-8),
    clipped to [-5, 5]; without them it sees the raw observation. `name`, `seed`, `steps`: what the
    file says of its origin.

    Raises UserError for a role that is none, for arrays that do not fit together, for NaN, and
    where `path` exists (unless `force`).
    """
    if role not in SIDES:
        raise UserError(f"role {one_line(role)}: {' or '.join(SIDES)} is allowed", EXIT_CONFIG)
    if (mean is None) != (variance is None):
        raise UserError("mean and variance: give both or none", EXIT_CONFIG)
    plain = lambda array: np.asarray(array, np.float32)
    size = observation_of(config).size
    scaled = mean is not None
    moments = (mean, variance) if scaled else (np.zeros(size), np.ones(size))
    scaler = Scaler(*map(plain, (*moments, 1.0)))  # pyright: ignore
    network = MLP(tuple(map(plain, weights)), tuple(map(plain, biases)))  # pyright: ignore
    spread = plain(np.zeros(ACTION_SIZE) if log_std is None else log_std)
    info = PolicyInfo(
        role=role,
        layer_sizes=(size, *(layer.shape[-1] for layer in network.biases)),
        normalize_observations=scaled,
        environment=environment(config),
        run=name,
        seed=seed,
        chunk=0,
        steps=steps,
        package_version=package_version(),
        jax_version=metadata.version("jax"),
        config_sha256=hashlib.sha256(to_toml(config).encode()).hexdigest(),
    )
    save_policy(Path(path), Policy(network, spread, scaler), info, force=force)  # pyright: ignore
    return Path(path)
