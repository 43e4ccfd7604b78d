"""The scene, and a copy of its files."""

import shutil
from pathlib import Path

import pytest

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.sim.scene import Scene, load_scene
from dronecombat_jax.sim.source import find_mjcf_dir


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(SimConfig())


@pytest.fixture
def mjcf(tmp_path: Path) -> Path:
    """A writable copy of the MJCF folder."""
    return Path(shutil.copytree(find_mjcf_dir(), tmp_path / "mjcf"))
