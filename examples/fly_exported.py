"""Fly an exported policy with NumPy alone, as a robot would: no JAX, no MuJoCo.

dronecombat export ippo attacker.safetensors --role attacker
python fly_exported.py attacker.safetensors
"""

import sys

import numpy as np

from dronecombat_jax.policies.numpy_policy import NumpyPolicy  # one file: copy it to your robot


def main(path: str) -> np.ndarray:
    """The action for a hovering drone; what the numbers mean is in the file."""
    policy = NumpyPolicy(path)
    print(
        {key: policy.about[key] for key in ("role", "observation", "control_dt", "action_fields")}
    )
    observation = np.zeros(policy.mean.size, np.float32)
    return np.clip(policy(observation), -1.0, 1.0)


if __name__ == "__main__":
    print(main(sys.argv[1]))
