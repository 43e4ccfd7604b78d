"""How long a benchmark waits for a child: XLA's CPU runtime of jax 0.10 sleeps for ever on two
cores.

A child says that it is alive after each program that it has compiled or called. If it says nothing
for two minutes and takes no time of a processor either, it has hung: it is killed, and the
benchmark goes on without it. What does not live here: what a child says otherwise (`worker`,
`start`).
"""

import contextlib
import json
import os
import queue
import subprocess
import threading
import time
from pathlib import Path
from typing import TextIO

SECONDS = 120.0  # of silence: then a child must at least have computed
AT_WORK = 0.02  # cores that a child takes at the least while it computes, on a busy machine too
MOST_SECONDS = 600.0  # of silence of a child that computes
POLL_SECONDS = 0.5
ALIVE = "alive"

answers: TextIO | None = None  # of a child: where its parent listens


class Hung(RuntimeError):
    """A child has hung and was killed. The message, one line, names it."""


def alive() -> None:
    """Tell the parent, if this process is a child of a benchmark, that something has been done."""
    if answers is not None:
        print(json.dumps(ALIVE), file=answers, flush=True)


def end(process: subprocess.Popen[str]) -> None:
    """Kill a child, and close the pipe into it."""
    process.kill()
    process.wait()
    if process.stdin is not None:
        with contextlib.suppress(OSError):  # what it has not read is lost
            process.stdin.close()


class Watch:
    """Over a child from which something is expected, from now on."""

    def __init__(self, process: subprocess.Popen[str], name: str):
        """`name` is for the message."""
        self._process, self._name = process, name
        self.heard()

    def heard(self) -> None:
        """The child has given a sign of life."""
        self._silent_since = self._asked_at = time.monotonic()
        self._cpu_seconds = cpu_seconds(self._process.pid)

    def check(self) -> None:
        """Kill the child and raise Hung, if it has been silent for too long."""
        now = time.monotonic()
        if now - self._asked_at < SECONDS:
            return
        used, silent = cpu_seconds(self._process.pid) - self._cpu_seconds, now - self._silent_since
        if used < AT_WORK * SECONDS or silent >= MOST_SECONDS:
            self._process.kill()
            last = f"{used:.1f} s of CPU in the last {now - self._asked_at:.0f} s"
            raise Hung(f"{self._name} hung: silent for {silent:.0f} s, {last}")
        self._asked_at, self._cpu_seconds = now, self._cpu_seconds + used


class Listener:
    """Lines of a child's stdout, none of them waited for without end."""

    def __init__(self, process: subprocess.Popen[str], name: str):
        """`process`, its stdout a pipe of text that nobody else reads; `name` is for the message."""
        self._process, self._name = process, name
        self._lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def next_line(self) -> str:
        """The next line; "" at the end. Raises Hung, see `Watch.check`."""
        watch = Watch(self._process, self._name)
        while True:
            try:
                return self._lines.get(timeout=POLL_SECONDS)
            except queue.Empty:
                watch.check()

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                self._lines.put(line)
        self._lines.put("")


def cpu_seconds(pid: int) -> float:
    """CPU seconds of a process so far; 0 where the system does not tell."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
