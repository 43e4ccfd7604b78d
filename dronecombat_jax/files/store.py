"""A checkpoint's arrays on disk: orbax, as NumPy in one OCDBT store."""

import contextlib
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dronecombat_jax.errors import EXIT_CANNOT_WRITE, UserError
from dronecombat_jax.files.arrays import (
    Arrays,
    leaves_of,
)
from dronecombat_jax.files.atomic import (
    cannot_write,
    fsync_directory,
    fsync_tree,
    write_new,
)
from dronecombat_jax.files.manifest import (
    MANIFEST_NAME,
    CheckpointError,
    DamagedCheckpoint,
    Manifest,
    Roster,
    encode_manifest,
    list_files,
    state_digest,
)

STATE_NAME = "state"


def write(
    temporary: Path,
    final: Path,
    step: int,
    arrays: Arrays,
    digest: str,
    meta: dict[str, Any],
    players: Roster | None,
) -> None:
    """Fill `temporary`, read it back, prove it and see it to the disk."""
    target = temporary / STATE_NAME
    # orbax refuses arrays without elements; the manifest alone describes them
    stored = {path: array for path, array in arrays.items() if array.size}
    try:
        with _orbax() as checkpointer:
            checkpointer.save(target.absolute(), stored)
    except (OSError, ValueError, RuntimeError) as error:  # how tensorstore reports a full disk
        raise cannot_write(final, error, bytes_of(arrays)) from error
    fsync_tree(target)
    manifest = Manifest(
        step, digest, leaves_of(arrays), list_files(temporary, STATE_NAME), meta, players
    )
    try:
        read(temporary, manifest)
    except CheckpointError as error:
        message = f"cannot write {final}: what was read back differs ({error})"
        raise UserError(message, EXIT_CANNOT_WRITE) from error
    write_new(temporary / MANIFEST_NAME, encode_manifest(manifest))
    fsync_directory(temporary)


def read(checkpoint: Path, manifest: Manifest) -> Arrays:
    """Arrays by path, proven by the digest. The files have been checked before they come here."""
    stored = {leaf.path for leaf in manifest.leaves if 0 not in leaf.shape}
    try:
        with _orbax() as checkpointer:
            arrays = checkpointer.restore(
                (checkpoint / STATE_NAME).absolute(), restore_args=_as_numpy(stored)
            )
        arrays = {path: np.asarray(array) for path, array in arrays.items()}
        for leaf in manifest.leaves:
            if 0 in leaf.shape:
                arrays[leaf.path] = np.zeros(leaf.shape, np.dtype(leaf.dtype))
        digest = state_digest(arrays)
    except Exception as error:
        reason = " ".join(str(error).split())[:200]
        raise DamagedCheckpoint(
            f"{checkpoint} cannot be read: {type(error).__name__}: {reason}"
        ) from error
    if digest != manifest.digest or leaves_of(arrays) != manifest.leaves:
        raise DamagedCheckpoint(f"{checkpoint} is damaged: its arrays do not match their sha256")
    return arrays


@contextlib.contextmanager
def _orbax() -> Iterator[Any]:
    """Orbax's synchronous checkpointer, without the page of log that it prints for a full disk.

    Of several processes it waits for none: only this one reads or writes.
    """
    import jax
    import orbax.checkpoint as ocp

    here = jax.process_index()
    alone = ocp.options.MultiprocessingOptions(
        primary_host=here, active_processes={here}, barrier_sync_key_prefix=f"process{here}"
    )
    logger = logging.getLogger("absl")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        handler = ocp.PyTreeCheckpointHandler(use_ocdbt=True, multiprocessing_options=alone)
        with ocp.Checkpointer(handler, multiprocessing_options=alone) as checkpointer:
            yield checkpointer
    finally:
        logger.setLevel(level)


def _as_numpy(paths: set[str]) -> dict[str, Any]:
    import orbax.checkpoint as ocp

    return {path: ocp.RestoreArgs(restore_type=np.ndarray) for path in paths}


def bytes_of(arrays: Arrays) -> int:
    """Bytes of all arrays together, without what the file system adds."""
    return sum(array.nbytes for array in arrays.values())
