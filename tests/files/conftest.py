"""A checkpoint for the tests of faults."""

from pathlib import Path

import pytest
from saved_steps import META, small_state

from dronecombat_jax.files import checkpoint


@pytest.fixture(scope="module")
def golden(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with the small checkpoint 5."""
    directory = tmp_path_factory.mktemp("golden")
    checkpoint.save(directory, 5, small_state(), META)
    return directory
