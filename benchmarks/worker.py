"""A part of the benchmark in a process of its own, and the parent's handle on it.

The child builds its programs with a cold compile cache, calls each once, and reports. It then stays
alive and runs every program once whenever it is told to: parts take turns, so that a shared host's
drift hits all alike. One JSON object a line in both directions. A child that hangs is killed
(`patience`). What does not live here: the parts themselves (`ceilings`, `references`, `stepping`,
`training`).
"""

import importlib
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks import patience
from benchmarks.size import Size

ROOT = Path(__file__).parents[1]
# A wrong kernel for this processor, where somebody has set them for another one; NumPy's ceiling is
# measured without.
OPENBLAS_OVERRIDES = ("OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE")


class Program(NamedTuple):
    """What is called again and again: `work` in `unit`s a call."""

    name: str
    unit: str  # of the rate, such as "steps/s"
    work: float
    # returns when done: None, or the seconds that count, where that is not all
    call: Callable[[], float | None]


@dataclass
class Part:
    """What a part's build function returns."""

    programs: list[Program] = field(default_factory=list)
    compile_seconds: dict[str, float] = field(default_factory=dict)  # by program, cold
    # of the process, once the first program has been called; None: at the end
    peak_mib: float | None = None
    facts: dict[str, Any] = field(default_factory=dict)  # whatever else belongs into the record


class Kind(NamedTuple):
    """Where a part is built and in what process."""

    build: str  # "module:function" in this folder, called with the size and `arguments`
    arguments: tuple = ()
    one_core: bool = False  # the whole process on one core


KINDS: dict[str, Kind] = {
    "numpy": Kind("ceilings:numpy_products"),
    "numpy-1": Kind("ceilings:numpy_products", one_core=True),
    "xla": Kind("ceilings:xla_products"),
    "xla-1": Kind("ceilings:xla_products", one_core=True),
    "memory": Kind("ceilings:memory"),
    "mujoco": Kind("references:mujoco_rollout"),
    "step": Kind("stepping:stepping", (False,)),
    "step-cores": Kind("stepping:stepping", (True,)),
    "ippo": Kind("training:ippo", (1,)),
    "ippo-seeds": Kind("training:ippo", (2,)),
    "sippo": Kind("training:sippo"),
    "tournament": Kind("training:tournament"),
    # only in benchmarks.scaling:
    "iteration": Kind("training:iteration"),
    "sippo-pool": Kind("training:sippo", ("chunk", True)),
    "sippo-pool-environment": Kind("training:sippo", ("environment", True)),
}


class Worker:
    """The parent's handle: starting it waits until the child is ready. A context manager.

    Raises RuntimeError where the child dies, and its subclass `patience.Hung` where it hangs.
    """

    def __init__(self, name: str, size: Size, cache: Path | None = None):
        """`cache`: a compile cache to use; None: an empty one, so that compile times are cold."""
        self.name = name
        self._held = ExitStack()
        if cache is None:
            cache = Path(
                self._held.enter_context(tempfile.TemporaryDirectory(prefix="dronecombat-bench-"))
            )
        self._stderr = self._held.enter_context(tempfile.TemporaryFile("w+"))  # noqa: SIM115 - closed with the others
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.worker", name, size.to_json()],
            cwd=ROOT,
            env=environment(KINDS[name], str(cache)),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._stderr,
            text=True,
        )
        self._listener = patience.Listener(self._process, f"part {name}")
        try:
            self.ready: dict[str, Any] = self._answer()
        except BaseException:  # Ctrl-C, too: no process is left behind
            self.close()
            raise

    def __enter__(self) -> "Worker":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def repeat(self) -> dict[str, float]:
        """Let it run every program once; rates by name."""
        assert self._process.stdin is not None
        print("again", file=self._process.stdin, flush=True)
        return self._answer()

    def close(self) -> None:
        """End the child and remove what it leaves."""
        patience.end(self._process)
        self._held.close()

    def _answer(self) -> Any:
        while line := self._listener.next_line():
            if (answer := json.loads(line)) != patience.ALIVE:
                return answer
        self._process.wait()
        self._stderr.seek(0)
        raise RuntimeError(
            f"part {self.name} died (exit code {self._process.returncode}):\n{self._stderr.read()}"
        )


def environment(kind: Kind, cache: str) -> dict[str, str]:
    """The child's environment: this one, with a compile cache in the folder `cache`, and NumPy's
    BLAS as it chooses.
    """
    ours = {key: value for key, value in os.environ.items() if key != "JAX_COMPILATION_CACHE_DIR"}
    ours["DRONECOMBAT_CACHE"] = cache
    if kind.build == "ceilings:numpy_products":
        for key in OPENBLAS_OVERRIDES:
            # both or neither: a cache size without its kernel is worse than either
            ours.pop(key, None)
    if kind.one_core:
        ours["OPENBLAS_NUM_THREADS"] = "1"
    return ours


def build(name: str, size: Size) -> Part:
    """Build the part `name` in this process."""
    module, function = KINDS[name].build.split(":")
    return getattr(importlib.import_module(f"benchmarks.{module}"), function)(
        size, *KINDS[name].arguments
    )


def run(part: Part) -> dict[str, float]:
    """Run every program once; units of work per second, by name."""
    rates = {}
    for program in part.programs:
        start = time.perf_counter()
        seconds = program.call()
        rates[program.name] = program.work / (
            time.perf_counter() - start if seconds is None else seconds
        )
        patience.alive()
    return rates


def peak_mib() -> float:
    """Peak resident memory of this process so far, in MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def end_tidily() -> None:
    """Let SIGTERM end this process as an exit does: the processes and folders that it has made go
    with it.
    """
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))


def main() -> None:
    """The child: build the part argv[1] at size argv[2], then run it once for every line that comes
    in.
    """
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # whatever a library prints must not mix with the answers
    patience.answers = answers
    name = sys.argv[1]
    if KINDS[name].one_core:
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    part = build(name, Size.from_json(sys.argv[2]))
    run(part)
    report = {
        "units": {program.name: program.unit for program in part.programs},
        "work": {program.name: program.work for program in part.programs},
        "compile_seconds": part.compile_seconds,
        "peak_mib": part.peak_mib or peak_mib(),
        "facts": part.facts,
    }
    print(json.dumps(report), file=answers, flush=True)
    for _ in sys.stdin:
        print(json.dumps(run(part)), file=answers, flush=True)


if __name__ == "__main__":
    main()
