"""TensorBoard events, one folder per seed, written by the calling thread.

tensorboardX's `SummaryWriter` is avoided: its thread dies on a full disk and the next ten calls
then wait for it for ever. Its event writer below it has no thread.
"""

import os
import secrets
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dronecombat_jax.files.atomic import cannot_write

_NOT_CURVES = ("steps", "seed")


class EventLog:
    """Scalars of each record under `directory/seed-<seed>/`, on the axis of environment steps."""

    def __init__(self, directory: Path, resume_steps: int | None = None):
        """`resume_steps`: hide what earlier event files hold beyond these environment steps."""
        self._directory = directory
        self._resume_steps = resume_steps
        self._writers: dict[int, Any] = {}

    def add(self, record: Mapping[str, Any]) -> None:
        """Write the numbers of one record; None and text are left out."""
        from tensorboardX.proto.event_pb2 import Event  # pyright: ignore[reportAttributeAccessIssue] - generated
        from tensorboardX.proto.summary_pb2 import Summary  # pyright: ignore[reportAttributeAccessIssue]

        values = [
            Summary.Value(tag=key, simple_value=value)
            for key, value in record.items()
            if isinstance(value, int | float) and key not in _NOT_CURVES
        ]
        writer = self._writer(int(record.get("seed") or 0))
        event = Event(
            wall_time=time.time(), step=int(record["steps"]), summary=Summary(value=values)
        )
        self._attempt(writer.write_event, event)

    def flush(self) -> None:
        """Hand everything to the system, so that an open TensorBoard sees it."""
        for writer in self._writers.values():
            self._attempt(writer.flush)

    def close(self) -> None:
        """Flush and close the event files."""
        writers, self._writers = self._writers, {}
        for writer in writers.values():
            self._attempt(writer.close)

    def _writer(self, seed: int) -> Any:
        if seed not in self._writers:
            self._writers[seed] = self._attempt(self._open, self._directory / f"seed-{seed}")
        return self._writers[seed]

    def _open(self, folder: Path) -> Any:
        from tensorboardX.event_file_writer import EventsWriter
        from tensorboardX.proto.event_pb2 import Event, SessionLog  # pyright: ignore[reportAttributeAccessIssue]

        folder.mkdir(parents=True, exist_ok=True)
        # the library's name has a resolution of one second: a quick restart would overwrite the
        # file
        writer = EventsWriter(str(folder / "events"), f".{os.getpid()}.{secrets.token_hex(4)}")
        if self._resume_steps is not None:
            start = SessionLog(status=SessionLog.START)
            writer.write_event(
                Event(wall_time=time.time(), step=self._resume_steps + 1, session_log=start)
            )
        return writer

    def _attempt(self, action: Any, *arguments: Any) -> Any:
        try:
            return action(*arguments)
        except OSError as error:
            raise cannot_write(self._directory, error) from error
