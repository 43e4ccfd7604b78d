"""Write a policy that was trained elsewhere to a policy file: your own network, either frame."""

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np

import dronecombat_jax as dc


def main(out: str, role: str = "attacker", frame: str = "ego", seed: int = 0) -> Path:
    """Random weights stand for yours: x @ weights + biases, ELU between layers, 35 to 4."""
    dc.prepare("cpu")
    from dronecombat_jax.policies.foreign import save_network

    draw = np.random.default_rng(seed).standard_normal
    weights = [draw(size) * size[0] ** -0.5 for size in pairwise((35, 48, 32, 4))]
    biases = [np.zeros(weight.shape[1]) for weight in weights]
    game = dc.load_config("duel", {"game.observation": frame})  # that it was trained in
    return save_network(out, role, game, weights, biases, force=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
