"""The directory of one run, `runs/<name>/`: its paths, who may write there, where to find it.

What does not live here: the content of the files (`checkpoint`, `metrics`, `dronecombat_jax.report`).
"""

import difflib
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.runs.atomic import cannot_write, sweep, temporary_path, write_new
from dronecombat_jax.runs.lock import exclusive_lock

_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}")


@dataclass(frozen=True)
class RunDirectory:
    """Paths of one run; making the object touches nothing."""

    path: Path
    inode: tuple[int, int] | None = None  # device and inode when it was claimed; None: only read

    @property
    def name(self) -> str:
        return self.path.name

    @property
    def config(self) -> Path:
        return self.path / "config.toml"

    @property
    def metrics(self) -> Path:
        return self.path / "metrics.jsonl"

    @property
    def tensorboard(self) -> Path:
        return self.path / "tensorboard"

    @property
    def checkpoints(self) -> Path:
        return self.path / "checkpoints"

    @property
    def figures(self) -> Path:
        return self.path / "figures"

    @property
    def video(self) -> Path:
        return self.path / "fight.mp4"

    @property
    def evaluation(self) -> Path:
        return self.path / "evaluation.json"


def check_name(name: str) -> str:
    """The name itself, if it can be a directory everywhere; else UserError 2."""
    if not _NAME.fullmatch(name):
        raise UserError(
            f"run name {name[:120]!r} is not allowed: 1 to 100 of the characters A-Z a-z 0-9 . _ -, "
            "the first not a dot",
            EXIT_CONFIG,
        )
    return name


def run_path(root: Path | str, name: str) -> Path:
    """`root/name`. UserError 2 for a bad name, or where a link leads out of `root`."""
    path = Path(root) / check_name(name)
    if path.resolve().parent != Path(root).resolve():
        raise UserError(f"run {path} is a link that leads out of {root}: {path.resolve()}", EXIT_CONFIG)
    return path


def find_run(root: Path | str, name: str) -> RunDirectory:
    """An existing run, for reading: by name below `root`, or by a path (anything with a slash).

    Raises UserError 2 that lists the runs which exist.
    """
    path = Path(name) if os.sep in name else run_path(root, name)
    if path.is_dir():
        return RunDirectory(path)
    runs = sorted(entry.name for entry in path.parent.iterdir() if entry.is_dir()) if path.parent.is_dir() else []
    close = difflib.get_close_matches(path.name, runs, n=1)
    meant = f"; did you mean {close[0]!r}?" if close else ""
    shown = ", ".join(runs[:10]) + (", ..." if len(runs) > 10 else "") if runs else "none"
    raise UserError(f"no run {path.name!r} in {path.parent}{meant} (runs there: {shown})", EXIT_CONFIG)


@contextmanager
def claim_run(root: Path | str, name: str) -> Iterator[RunDirectory]:
    """Create or open a run for writing and hold its lock; needs no JAX, answers at once.

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
