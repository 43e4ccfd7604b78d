"""Start a program again and again, each time in a process of its own, and count how many finish.

XLA's CPU runtime of jax 0.10 deadlocks on two cores: the process then sleeps for ever. One good
process proves nothing, so this starts N of them, one after another, each under a time limit.

    python -m benchmarks.hangs step-cores --processes 100 --python .venv/bin/python
    python -m benchmarks.hangs smoke smoke-2 --processes 20 --json build/hangs.json

Prints a table and, as the last line, one JSON object. Exit code 0 if all finished, else 1.
"""

import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.patience import AT_WORK, cpu_seconds
from benchmarks.record import PREFIXES, ROOT
from benchmarks.size import Size

VERSIONS = """
import json, os, platform
from importlib import metadata
names = ("jax", "jaxlib", "flax", "mujoco", "mujoco-mjx")
print(json.dumps({"python": platform.python_version(), "cores": len(os.sched_getaffinity(0)),
                  **{name: metadata.version(name) for name in names}}))
"""
LOOK_SECONDS = 20.0  # at a process whose time is over: does it compute?
CALLS = 2  # of the three programs of a part of the benchmark, after the first ones
TAIL = 500  # characters of stderr that are kept of a process that did not finish


class Process(NamedTuple):
    """One process: `verdict` is finished, failed, or, killed at the limit, slow or hung.

    A hung one took no time of a processor any more: a deadlock, not slowness.
    """

    number: int
    verdict: str
    exit_code: int
    seconds: float  # wall clock
    cpu_seconds: float
    stderr: str


def part(number: int, folder: str) -> list[str]:
    """The environment alone, a virtual device per core: what hung with jax 0.10.1 in `make bench`."""
    return ["benchmarks.worker", "step-cores", Size().to_json()]


def training(num_seeds: int) -> Callable[[int, str], list[str]]:
    """A smoke training of seeds from `number` on; several are spread over virtual devices."""

    def words(number: int, folder: str) -> list[str]:
        return [
            *("dronecombat_jax", "train", "--preset", "smoke", "--run.directory", folder),
            *(
                "--seed",
                str(number),
                "--train.num-seeds",
                str(num_seeds),
                "--name",
                f"smoke-{number}",
            ),
        ]

    return words


# What can be looped over: the words after `python -m`, for a process's number and a folder of its
# own.
PROGRAMS: dict[str, Callable[[int, str], list[str]]] = {
    "step-cores": part,
    "smoke": training(1),
    "smoke-2": training(2),
}


def main() -> int:
    """Read the flags, start the processes, print the table; 0 if all finished."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "programs", nargs="+", choices=PROGRAMS, metavar="PROGRAM", help=", ".join(PROGRAMS)
    )
    parser.add_argument(
        "--processes", type=int, default=20, help="of each program (default %(default)s)"
    )
    parser.add_argument(
        "--limit", type=float, default=300.0, help="seconds each may take (default %(default)s)"
    )
    parser.add_argument(
        "--python", default=sys.executable, help="the interpreter (default: this one)"
    )
    parser.add_argument(
        "--cold", action="store_true", help="an empty compile cache for every process"
    )
    parser.add_argument("--json", type=Path, help="write the JSON object to this file too")
    flags = parser.parse_args()
    python = os.path.abspath(flags.python)

    versions = json.loads(subprocess.check_output([python, "-c", VERSIONS], text=True))
    print(", ".join(f"{name} {version}" for name, version in versions.items()))
    loops = {
        name: loop(name, flags.processes, python, flags.limit, flags.cold)
        for name in flags.programs
    }
    result = {
        "versions": versions,
        "environment": {
            key: value for key, value in sorted(os.environ.items()) if key.startswith(PREFIXES)
        },
        "limit_seconds": flags.limit,
        "cold": flags.cold,
        "loops": loops,
    }
    if flags.json:
        flags.json.parent.mkdir(parents=True, exist_ok=True)
        flags.json.write_text(json.dumps(result, indent=1) + "\n")
    print(json.dumps(result))
    return 0 if all(each["finished"] == flags.processes for each in loops.values()) else 1


def loop(name: str, count: int, python: str, limit: float, cold: bool) -> dict[str, Any]:
    """`count` processes of a program, one after another; how many ended in which way, and each."""
    print(f"{name:>11} {'verdict':>9} {'exit':>5} {'seconds':>8} {'cpu s':>8}")
    processes = []
    for number in range(1, count + 1):
        with tempfile.TemporaryDirectory(prefix="dronecombat-hangs-") as folder:
            environment = dict(os.environ)
            if cold:
                environment.pop("JAX_COMPILATION_CACHE_DIR", None)
                environment["DRONECOMBAT_CACHE"] = folder
            command = [python, "-m", *PROGRAMS[name](number, folder)]
            processes.append(run(number, command, environment, limit))
        _, verdict, exit_code, seconds, cpu_seconds, _ = processes[-1]
        print(
            f"{number:11} {verdict:>9} {exit_code:5} {seconds:8.1f} {cpu_seconds:8.1f}", flush=True
        )
    verdicts = [process.verdict for process in processes]
    counts = {
        verdict: verdicts.count(verdict) for verdict in ("finished", "failed", "slow", "hung")
    }
    others = ", ".join(f"{number} {verdict}" for verdict, number in list(counts.items())[1:])
    print(f"{name}: {counts['finished']} of {count} finished, {others}")
    return counts | {"processes": [process._asdict() for process in processes]}


def run(number: int, command: Sequence[str], environment: dict[str, str], limit: float) -> Process:
    """One process, killed after `limit` seconds.

    A part of the benchmark does `CALLS` more calls.
    """
    before, start = _child_cpu_seconds(), time.monotonic()
    with tempfile.TemporaryFile("w+") as stderr:
        process = subprocess.Popen(
            command,
            cwd=ROOT,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=stderr,
            text=True,
            start_new_session=True,
        )
        try:
            process.communicate("again\n" * CALLS, timeout=limit)
            verdict = "finished" if process.returncode == 0 else "failed"
        except subprocess.TimeoutExpired:
            verdict = "slow" if computes(process.pid) else "hung"
        finally:
            if process.poll() is None:  # also when this benchmark itself is interrupted
                os.killpg(process.pid, signal.SIGKILL)
        exit_code = process.wait()
        stderr.seek(0)
        words = "" if verdict == "finished" else stderr.read()[-TAIL:]
    seconds, cpu_seconds = time.monotonic() - start, _child_cpu_seconds() - before
    return Process(number, verdict, exit_code, round(seconds, 2), round(cpu_seconds, 2), words)


def computes(pid: int) -> bool:
    """Whether a process takes time of a processor: one in a deadlock sleeps."""
    before = cpu_seconds(pid)
    time.sleep(LOOK_SECONDS)
    return cpu_seconds(pid) - before >= AT_WORK * LOOK_SECONDS


def _child_cpu_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    sys.exit(main())
