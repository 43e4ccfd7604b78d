"""Who may write into a run's directory: claiming it, noticing that it has gone, replacing it. Needs
no JAX.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dronecombat_jax.files.atomic import cannot_write, sweep, temporary_path, write_new
from dronecombat_jax.files.lock import exclusive_lock
from dronecombat_jax.files.rundir import RunDirectory, run_path


@contextmanager
def claim_run(root: Path | str, name: str) -> Iterator[RunDirectory]:
    """Create or open a run for writing and hold its lock; answers at once.

    Left-overs of killed writers are swept. Raises UserError 2 for a bad name, 73 where the
    directory cannot be written or another process holds it.
    """
    path = run_path(root, name)
    _make_directory(path)
    _probe(path)
    with exclusive_lock(path):
        status = path.stat()
        run = RunDirectory(path, (status.st_dev, status.st_ino))
        for folder in (run.checkpoints, run.tensorboard, run.figures):
            _make_directory(folder)
        for folder in (run.path, run.checkpoints, run.figures):
            sweep(folder)
        yield run


def still_there(run: RunDirectory) -> bool:
    """Whether the claimed directory is still found under its path (not renamed, not deleted)."""
    try:
        status = run.path.stat()
    except OSError:
        return False
    return run.inode == (status.st_dev, status.st_ino)


def rescue_run(run: RunDirectory) -> RunDirectory:
    """A new directory `<run>.rescued-<pid>` for a run whose directory has gone from its path.

    The caller writes the configuration and a checkpoint there. The name is this process's own,
    so no lock is needed.
    """
    path = run.path.with_name(f"{run.path.name}.rescued-{os.getpid()}")
    _make_directory(path)
    status = path.stat()
    rescued = RunDirectory(path, (status.st_dev, status.st_ino))
    for folder in (rescued.checkpoints, rescued.tensorboard, rescued.figures):
        _make_directory(folder)
    return rescued


def _make_directory(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(path, error) from error


def _probe(path: Path) -> None:
    """Write and remove a small file: permission bits alone do not tell (read-only mount, quota)."""
    probe = temporary_path(path / "probe")
    try:
        write_new(probe, b"x")
    except OSError as error:
        raise cannot_write(path, error) from error
    finally:
        probe.unlink(missing_ok=True)
