"""What every test shares: the environment is settled before JAX starts, programs are compiled once."""

import os
from pathlib import Path

import pytest

from dronecombat_jax import backend

os.environ.setdefault("DRONECOMBAT_CACHE", str(Path(__file__).parents[1] / ".cache"))
backend.prepare("cpu")


@pytest.fixture(scope="session")
def rendering() -> None:
    """Skip, naming the Debian packages, where MuJoCo cannot render a picture."""
    if fault := backend.rendering_fault():
        pytest.skip(fault)
