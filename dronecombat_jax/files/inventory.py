"""What lies in a folder: runs, tournaments and policy files, each with its state. Reads, never
writes. Needs no JAX.

What does not live here: what may be removed (`prune`), how it is printed (`cli.inventory`).
"""

import json
import os
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.errors import UserError
from dronecombat_jax.files import checkpoint, tensorfile
from dronecombat_jax.files.lock import in_use
from dronecombat_jax.files.manifest import CheckpointError, Manifest
from dronecombat_jax.files.rundir import RunDirectory

RUNNING, STOPPED, FINISHED, DAMAGED, EMPTY, WHOLE = (
    "running", "stopped", "finished", "damaged", "empty", "whole",
)  # fmt: skip
RUN, TOURNAMENT, POLICY = "run", "tournament", "policy"
OUTCOMES = ("defender", "attacker", "draw")  # as files name them
CELLS, RESULT, ABOUT = "cells", "result.npz", "result.json"  # of a tournament
_TAIL_BYTES = 1 << 18  # of a log that are looked at


class Item(NamedTuple):
    """One run, tournament or policy file."""

    kind: str
    path: Path
    state: str
    done: int = 0  # environment steps of a seed, or fights
    total: int = 0  # 0: not known
    outcomes: tuple[float, ...] = ()  # shares by `OUTCOMES`, of the last chunk or of all fights
    size: int = 0  # bytes
    note: str = ""  # what a reader should know


def inventory(folder: Path) -> list[Item]:
    """Everything in `folder`, in its `runs` and in its `tournaments`, by kind and name."""
    places = (folder, folder / "runs", folder / "tournaments")
    entries = [entry for place in places if place.is_dir() for entry in sorted(place.iterdir())]
    items = [item for entry in entries if (item := _look(entry)) is not None]
    kinds = (RUN, TOURNAMENT, POLICY)
    return sorted(items, key=lambda item: kinds.index(item.kind))


def is_run(path: Path) -> bool:
    """Whether a folder is, or was to become, a run's."""
    return path.is_dir() and (path / "checkpoints").is_dir()


def is_tournament(path: Path) -> bool:
    """Whether a folder is, or was to become, a tournament's."""
    return path.is_dir() and ((path / CELLS).is_dir() or (path / RESULT).is_file())


def size_of(path: Path) -> int:
    """Bytes of a file, or of all files below a folder; links are not followed.

    What goes while it is looked at, as a running run's temporary files do, counts nothing.
    """
    try:
        if path.is_symlink() or not path.is_dir():
            return path.lstat().st_size
        return sum(size_of(Path(entry.path)) for entry in os.scandir(path))
    except FileNotFoundError:
        return 0


def _look(path: Path) -> Item | None:
    """What `path` is; None for anything else, such as a hidden or temporary name."""
    if path.name.startswith("."):
        return None
    try:
        if is_run(path):
            item = _run(RunDirectory(path))
        elif is_tournament(path):
            item = _tournament(path)
        elif path.suffix == ".safetensors" and path.is_file():
            item = _policy(path)
        else:
            return None
        return item and item._replace(size=size_of(path))
    except OSError as error:  # removed or closed to us since it was listed
        kind = RUN if path.is_dir() else POLICY
        return Item(kind, path, DAMAGED, note=f"cannot be read: {error.strerror}")


def _run(run: RunDirectory) -> Item:
    newest, note = _newest(run.checkpoints)
    config, fault = _config(run, newest)
    rows = _last_rows(run.chunks, "chunk") or _last_rows(run.metrics, "iteration")
    saved = int(newest.meta.get("steps", 0)) if newest else 0
    done = max(saved, *(row["steps"] for row in _last_rows(run.metrics, "iteration")), 0)
    total = config.num_chunks * config.steps_per_chunk if config else 0
    if in_use(run.path):
        state, note = RUNNING, ""  # a checkpoint may have gone since, as `run.keep` asks for
    elif note or (fault and newest):
        state = DAMAGED
    elif newest is None:
        state = EMPTY
    else:
        state = FINISHED if saved >= total else STOPPED
    seeds = config.train.num_seeds if config else 1
    remark = note or fault or (f"{seeds} seeds" if seeds > 1 else "")
    done = done if state == RUNNING else saved
    return Item(RUN, run.path, state, done, total, _shares(rows), note=remark)


def _newest(checkpoints: Path) -> tuple[Manifest | None, str]:
    """The newest checkpoint that verifies, and a line on newer ones that do not."""
    note = ""
    for step in reversed(checkpoint.steps(checkpoints)):
        try:
            manifest = checkpoint.verify(checkpoints, step)
        except CheckpointError as error:
            note = note or one_line(error.message)
            continue
        return manifest, f"{note}; it goes on from {step}" if note else ""
    return None, note


def _config(run: RunDirectory, newest: Manifest | None) -> tuple[Config | None, str]:
    """A run's settings, of its newest checkpoint or as it was begun, or what is wrong with them."""
    try:
        text = newest.meta["config"] if newest else run.config.read_text()
        return settings.from_toml(text, str(run.config)), ""
    except FileNotFoundError:
        return None, ""
    except (OSError, UserError, KeyError, TypeError, ValueError) as error:
        return None, one_line(str(error).splitlines()[0])


def _last_rows(log: Path, key: str) -> list[dict[str, Any]]:
    """The records of a log's end that share its last `key`: one a seed."""
    try:
        with open(log, "rb") as file:
            file.seek(max(0, os.fstat(file.fileno()).st_size - _TAIL_BYTES))
            lines = file.read().split(b"\n")[:-1]
    except OSError:
        return []
    rows = list(_records(lines, key))
    return [row for row in rows if row[key] == rows[-1][key]]


def _records(lines: list[bytes], key: str) -> Iterator[dict[str, Any]]:
    """Of those lines that are records with `key`; the first may be torn, any may be damaged."""
    for line in lines:
        try:
            row = json.loads(line)
        except (ValueError, RecursionError):
            continue
        if isinstance(row, dict) and isinstance(row.get("steps"), int) and key in row:
            yield row


def _shares(rows: list[dict[str, Any]]) -> tuple[float, ...]:
    """Who won, by `OUTCOMES`, the mean over seeds; () where no fight ended."""
    known = [row for row in rows if isinstance(row.get("win/defender"), float)]
    if not known:
        return ()
    mean = lambda name: float(np.mean([row.get(f"win/{name}") or 0.0 for row in known]))
    return tuple(mean(name) for name in OUTCOMES)


def _tournament(path: Path) -> Item:
    flown, total, outcomes, note = 0, 0, (), ""
    complete = (path / RESULT).is_file()
    try:
        if complete:
            about = json.loads((path / ABOUT).read_text())
            total = int(about["pairs_asked"]) * int(about["episodes"])
            flown, outcomes = _result(path / RESULT, list(about["winner"].values()))
        else:
            flown = sum(_shard(shard) for shard in sorted((path / CELLS).glob("*.npz")))
    except (ValueError, KeyError, TypeError, AttributeError, OSError, zipfile.BadZipFile) as error:
        note = f"cannot be read: {one_line(str(error))}"
    if in_use(path):
        state = RUNNING
    elif note:
        state = DAMAGED
    elif not complete:
        state = STOPPED if flown else EMPTY
    else:
        state = FINISHED if flown >= total else STOPPED
    return Item(TOURNAMENT, path, state, flown, total, outcomes, note=note)


def _result(file: Path, winners: list[str]) -> tuple[int, tuple[float, ...]]:
    """Fights of a result, and who won, by `OUTCOMES`; `winners` by cause, the first of them 1."""
    with np.load(file, allow_pickle=False) as stored:
        counts = stored["counts"].sum(axis=(0, 1))[1 : len(winners) + 1]
    fights = int(counts.sum())
    won = lambda name: sum(
        int(count) for count, winner in zip(counts, winners, strict=True) if winner == name
    )
    return fights, tuple(won(name) / fights for name in OUTCOMES) if fights else ()


def _shard(file: Path) -> int:
    """Fights in one file of cells."""
    with np.load(file, allow_pickle=False) as stored:
        return int(stored["cause"].size)


def _policy(path: Path) -> Item | None:
    """A policy file; None for weights that are something else."""
    try:
        tensors, about = tensorfile.read(path)
    except UserError as error:
        return Item(POLICY, path, DAMAGED, note=one_line(error.message))
    if about.get("format") != "dronecombat-policy":
        return None
    origin = f"{about.get('role')} of {about.get('run')}, chunk {about.get('chunk')}"
    steps = about.get("steps", "")
    claimed = about.pop("sha256", "")
    state = WHOLE if claimed == tensorfile.digest_of(tensors, about) else DAMAGED
    note = one_line(origin) if state == WHOLE else "its sha256 does not match its content"
    return Item(POLICY, path, state, int(steps) if steps.isdecimal() else 0, note=note)
