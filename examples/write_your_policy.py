"""Write a policy that was trained elsewhere to a policy file: your own network, either frame."""

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np

import dronecombat_jax as dc


def main(out: str, role: str = "attacker", frame: str = "ego", seed: int = 0) -> Path:
    """A network of random weights; yours: x @ weights + biases, ELU between layers, 35 to 4."""
    config = dc.load_config("duel", {"game.observation": frame})
    dc.prepare("cpu")
    from dronecombat_jax.combat.fingerprint import environment
    from dronecombat_jax.policies.file import save_policy
    from dronecombat_jax.policies.info import PolicyInfo
    from dronecombat_jax.types import MLP, Policy, Scaler

    sizes, draw = (35, 48, 32, 4), np.random.default_rng(seed).standard_normal
    weights = tuple(
        (draw(shape) * shape[0] ** -0.5).astype(np.float32) for shape in pairwise(sizes)
    )
    biases = tuple(np.zeros(size, np.float32) for size in sizes[1:])
    sees = Scaler(
        np.zeros(35, np.float32), np.ones(35, np.float32), np.float32(1)
    )  # mean, variance
    policy = Policy(MLP(weights, biases), np.zeros(4, np.float32), sees)  # its log-std
    origin = {"run": "mine", "seed": 0, "chunk": 0, "steps": 0, "config_sha256": "0" * 64}
    made_by = {"package_version": "0", "jax_version": "0"}
    info = PolicyInfo(role, sizes, True, environment(config), **origin, **made_by)
    save_policy(Path(out), policy, info, force=True)
    return Path(out)


if __name__ == "__main__":
    main(*sys.argv[1:])
