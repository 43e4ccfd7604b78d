"""Learning curves on disk: `metrics.jsonl`, one JSON object per iteration, and TensorBoard events.

The JSON lines are the record, TensorBoard a view of it. Numbers go in as they are; NaN and infinity
become null. What the keys mean is decided by `records`, and for `chunks.jsonl`, by `chunks`.
"""

import json
import logging
import math
import numbers
import os
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.files.atomic import cannot_write, write_all, write_atomic
from dronecombat_jax.files.tensorboard import EventLog

Record = dict[str, Any]

_TENSORBOARD_FLUSH_SECONDS = 5.0
_log = logging.getLogger(__name__)


class MetricsWriter:
    """Appends records; a context manager. One writer per file: the run's lock sees to it."""

    def __init__(
        self, path: Path, tensorboard: Path | None = None, *, resume_steps: int | None = None
    ):
        """Open `path` for appending, and event files below `tensorboard` (None: none).

        `resume_steps`: environment steps of the checkpoint that is resumed; TensorBoard hides what
        it saw beyond them. Call `truncate_after` first. Raises UserError 73.
        """
        self._path = path
        try:
            self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
        except OSError as error:
            raise cannot_write(path, error) from error
        self._tensorboard = None if tensorboard is None else EventLog(tensorboard, resume_steps)
        self._flushed = time.monotonic()

    def __enter__(self) -> "MetricsWriter":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def write(self, record: Mapping[str, Any]) -> None:
        """Append one record, which needs "steps" and "seed".

        Raises UserError 73; no torn line is left.
        """
        plain = {key: _plain(key, value) for key, value in record.items()}
        line = json.dumps(plain, allow_nan=False, separators=(",", ":")).encode() + b"\n"
        size = os.fstat(self._descriptor).st_size
        try:
            write_all(self._descriptor, line)
        except OSError as error:
            os.ftruncate(self._descriptor, size)
            raise cannot_write(self._path, error, len(line)) from error
        if self._tensorboard is not None:
            self._tensorboard.add(plain)
            if time.monotonic() - self._flushed > _TENSORBOARD_FLUSH_SECONDS:
                self._tensorboard.flush()
                self._flushed = time.monotonic()

    def sync(self) -> None:
        """See every record to the disk: call it before the checkpoint that covers them."""
        try:
            os.fsync(self._descriptor)
        except OSError as error:
            raise cannot_write(self._path, error) from error
        if self._tensorboard is not None:
            self._tensorboard.flush()

    def close(self) -> None:
        """Close all files; may be called twice."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
        if self._tensorboard is not None:
            self._tensorboard.close()


def read(path: Path) -> list[Record]:
    """Every record.

    A torn last line is skipped; anything else that is no record is a UserError 3.
    """
    records, damaged, _ = _scan(path)
    if damaged:
        raise UserError(f"{path}, line {damaged[0]}: not a metrics record", EXIT_DATA)
    return [record for record, _ in records]


def truncate_after(path: Path, steps: int) -> int:
    """Cut the records past `steps` environment steps, and a torn last line; returns how many are
    left.

    A log must not stop a resume: lines in the middle that are no records are dropped with a
    warning, and the file as it was is kept as `<name>.damaged`.
    """
    if not path.exists():
        return 0
    records, damaged, torn = _scan(path)
    kept = [line for record, line in records if record["steps"] <= steps]
    if damaged:
        aside = path.with_name(path.name + ".damaged")
        _log.warning(
            "%s: %d damaged lines dropped, the first is line %d; kept as %s",
            path,
            len(damaged),
            damaged[0],
            aside.name,
        )
        write_atomic(aside, path.read_bytes())
    if damaged or torn or len(kept) < len(records):
        write_atomic(path, b"".join(line + b"\n" for line in kept))
    return len(kept)


def _scan(path: Path) -> tuple[list[tuple[Record, bytes]], list[int], bool]:
    """Records with their lines, the numbers of damaged lines, and whether the last line is torn."""
    try:
        lines = path.read_bytes().split(b"\n")
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror}", EXIT_DATA) from error
    torn = lines.pop() != b""  # a line counts once its newline is there
    records: list[tuple[Record, bytes]] = []
    damaged: list[int] = []
    for number, line in enumerate(lines, start=1):
        try:
            record = json.loads(line)
            if not isinstance(record["steps"], int):
                raise TypeError("steps")
            records.append((record, line))
        except (ValueError, TypeError, KeyError, RecursionError):
            damaged.append(number)
    return records, damaged, torn


def _plain(key: str, value: Any) -> Any:
    """A JSON scalar or a list of them: NumPy's and JAX's become Python's, NaN and infinity become
    None.
    """
    if value is None or isinstance(value, str | bool):
        return value
    if isinstance(value, list):
        return [_plain(key, item) for item in value]
    if isinstance(value, numbers.Integral):
        return int(value)
    if getattr(value, "shape", ()) != ():
        raise TypeError(f"metric {key} has shape {value.shape}: one number per key")
    value = value.item() if hasattr(value, "item") else value
    if isinstance(value, bool | int):
        return value
    return float(value) if math.isfinite(value) else None
