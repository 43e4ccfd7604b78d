"""Peers that take turns: one process each, all alive, one burst of work at a time.

In here: the child's side (`Turns`) and the parent's (`Peer`). One JSON object a line; the parent
writes the seconds of a burst, the child answers with its rate, and with what other processes took
of the cores meanwhile (None where the system does not tell). Not in here: what is measured.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks import patience

ROOT = Path(__file__).parents[2]


class Turns:
    """The child's side: call `done` after every call of the program; the first one has compiled it."""

    def __init__(self, steps: float):
        """`steps`: environment steps of one call."""
        self._steps, self._calls, self._seconds = steps, 0, 0.0
        self._start, self._own, self._all = time.perf_counter(), time.process_time(), busy_seconds()

    def done(self) -> None:
        """Return when there is more to do: at once within a burst, else when the parent asks. Ends
        the process with it.
        """
        self._calls += 1
        elapsed = time.perf_counter() - self._start
        if elapsed < self._seconds:
            return
        print(json.dumps(self._report(elapsed)), flush=True)
        line = sys.stdin.readline()
        if not line:
            sys.exit(0)
        self._calls, self._seconds = 0, float(line)
        self._start, self._own, self._all = time.perf_counter(), time.process_time(), busy_seconds()

    def _report(self, elapsed: float) -> dict[str, float | None]:
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        if not self._seconds:
            return {"first_call_seconds": elapsed, "peak_mib": peak}
        own, busy = time.process_time() - self._own, busy_seconds()
        others = (
            None
            if busy is None or self._all is None
            else max(0.0, busy - self._all - own) / elapsed
        )
        return {
            "steps_per_second": self._calls * self._steps / elapsed,
            "other_cores": others,
            "peak_mib": peak,
        }


def busy_seconds() -> float | None:
    """CPU seconds that all processes together, and other guests of the same host, have taken since
    the start (Linux).
    """
    try:
        columns = [
            int(word) for word in Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]
        ]
    except OSError:
        return None
    user, nice, system, _idle, _wait, irq, softirq, steal = columns
    return (user + nice + system + irq + softirq + steal) / os.sysconf("SC_CLK_TCK")


class Peer:
    """The parent's side; starting it waits until the child has done its first call. A context
    manager.
    """

    def __init__(self, name: str, module: str, *arguments: str):
        """`module` of this folder, run with `arguments`; its errors are kept for `ask`."""
        self.name = name
        self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 (closed with the process)
        self._process = subprocess.Popen(
            [sys.executable, "-m", f"benchmarks.peers.{module}", *arguments],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
        )
        self._listener = patience.Listener(self._process, name)
        try:
            self.first = self._answer()
        except BaseException:  # Ctrl-C, too: no process is left behind
            self.close()
            raise

    def __enter__(self) -> "Peer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def ask(self, seconds: float) -> dict[str, Any]:
        """One burst of about `seconds`: environment steps per second and the process's peak memory
        so far.
        """
        assert self._process.stdin is not None
        print(seconds, file=self._process.stdin, flush=True)
        return self._answer()

    def close(self) -> None:
        """End the child."""
        patience.end(self._process)
        self._errors.close()

    def _answer(self) -> dict[str, Any]:
        try:
            while line := self._listener.next_line():  # libraries print, too
                if line.startswith("{"):
                    return json.loads(line)
        except patience.Hung as hung:
            sys.exit(f"error: {hung}")
        self._process.wait()
        self._errors.seek(0)
        sys.exit(f"{self.name} ended with {self._process.returncode}:\n{self._errors.read()}")
