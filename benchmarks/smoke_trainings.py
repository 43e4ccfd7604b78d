"""Run smoke trainings one after another and count how many finish.

XLA's CPU runtime of jax 0.10 can deadlock on two cores: the process then sleeps for ever. One good run
proves nothing, so this runs N of them, each in its own process and under a time limit.

    python benchmarks/smoke_trainings.py --runs 20 --python .venv/bin/python --output smoke.json

Prints a table and, as the last line, one JSON object. Exit code 0 if every training finished, else 1.
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
from pathlib import Path
from typing import NamedTuple

VERSIONS = """
import json, os, platform
from importlib import metadata
names = ("jax", "jaxlib", "mujoco", "mujoco-mjx")
print(json.dumps({"python": platform.python_version(), "cores": len(os.sched_getaffinity(0)),
                  **{name: metadata.version(name) for name in names}}))
"""
TAIL = 500  # characters of a failed training's stderr that are kept


class Training(NamedTuple):
    """One training: `verdict` is finished, failed or hung (killed at the limit)."""

    number: int
    verdict: str
    exit_code: int
    seconds: float  # wall clock
    cpu_seconds: float  # near 0 per second of a hung one: a deadlock, not slowness
    stderr: str


def main() -> int:
    """Read the flags, run the trainings, print the table; 0 if all finished."""
    parser = argparse.ArgumentParser(description="Run smoke trainings and count how many finish.")
    parser.add_argument("--runs", type=int, default=20, help="number of trainings (default %(default)s)")
    parser.add_argument("--limit", type=float, default=300.0, help="seconds each may take (default %(default)s)")
    parser.add_argument("--python", default=sys.executable, help="the interpreter (default: this one)")
    parser.add_argument("--preset", default="smoke", help="what is trained (default %(default)s)")
    parser.add_argument("--output", type=Path, help="write the JSON object to this file too")
    flags = parser.parse_args()

    versions = json.loads(subprocess.check_output([flags.python, "-c", VERSIONS], text=True))
    print(", ".join(f"{name} {version}" for name, version in versions.items()))
    print(f"{'run':>4} {'verdict':>9} {'exit':>5} {'seconds':>8} {'cpu s':>8}")
    trainings = []
    for number in range(1, flags.runs + 1):
        trainings.append(train(number, flags.python, flags.preset, flags.limit))
        _, verdict, exit_code, seconds, cpu_seconds, _ = trainings[-1]
        print(f"{number:4} {verdict:>9} {exit_code:5} {seconds:8.1f} {cpu_seconds:8.1f}", flush=True)
    finished = sum(training.verdict == "finished" for training in trainings)
    print(f"{finished} of {flags.runs} finished")

    result = {
        "versions": versions,
        "preset": flags.preset,
        "limit_seconds": flags.limit,
        "runs": flags.runs,
        "finished": finished,
        "failed": sum(training.verdict == "failed" for training in trainings),
        "hung": sum(training.verdict == "hung" for training in trainings),
        "trainings": [training._asdict() for training in trainings],
    }
    if flags.output:
        flags.output.write_text(json.dumps(result, indent=1) + "\n")
    print(json.dumps(result))
    return 0 if finished == flags.runs else 1


def train(number: int, python: str, preset: str, limit: float) -> Training:
    """One training with seed `number` in a temporary folder, killed after `limit` seconds."""
    before, start = _child_cpu_seconds(), time.monotonic()
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile("w+") as stderr:
        command = [python, "-m", "dronecombat_jax.cli", "train", "--preset", preset, "--seed", str(number)]
        command += ["--name", f"smoke-{number}", "--run.directory", folder]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=stderr, start_new_session=True)
        try:
            verdict = "finished" if process.wait(limit) == 0 else "failed"
        except subprocess.TimeoutExpired:
            verdict = "hung"
        finally:
            if process.poll() is None:  # also when this benchmark itself is interrupted
                os.killpg(process.pid, signal.SIGKILL)
        exit_code = process.wait()
        stderr.seek(0)
        words = "" if verdict == "finished" else stderr.read()[-TAIL:]
    seconds, cpu_seconds = time.monotonic() - start, _child_cpu_seconds() - before
    return Training(number, verdict, exit_code, round(seconds, 2), round(cpu_seconds, 2), words)


def _child_cpu_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    sys.exit(main())
