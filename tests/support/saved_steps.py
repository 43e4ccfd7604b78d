"""A small checkpoint, and what may be read back from it."""

from pathlib import Path

import numpy as np

from dronecombat_jax.files import checkpoint
from dronecombat_jax.files.checkpoint import CheckpointError

META = {"steps": 120_000, "chunk": 5}


def small_state() -> dict[str, np.ndarray]:
    return {"a": np.arange(12, dtype=np.float32).reshape(3, 4), "b": np.array(3, np.int32)}


def files_of(directory: Path) -> list[Path]:
    return sorted(path for path in directory.rglob("*") if path.is_file())


def equal_or_error(directory: Path, step: int = 5):
    try:
        restored, meta = (
            checkpoint.restore(directory, step, small_state()),
            checkpoint.read_meta(directory, step),
        )
    except CheckpointError as error:
        assert "\n" not in error.message
        return
    assert meta == META
    for name, array in small_state().items():
        np.testing.assert_array_equal(restored[name], array)
