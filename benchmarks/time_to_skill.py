"""How long the attacker alone needs until it hits: the real command, watched through its
metrics.jsonl.

    python -m benchmarks.time_to_skill [--preset solo] [--seeds 0 1 2] [--share 0.95] [--json FILE]
    [FLAGS of train]

Skill is there at the first iteration from which on `--sustained` iterations in a row each have at
least `--share` hits among the fights that ended. Seconds count from the first program call's start,
as the command reports its compilation, to the arrival of that first record; then the training is
ended. They include what training does besides (metrics, checkpoints). A record arrives with its
program call, so seconds are exact to one call. Also printed: seconds from the command itself,
compilation included.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.patience import Watch
from benchmarks.record import Load, provenance
from benchmarks.start import COMPILED
from benchmarks.tables import head, table
from benchmarks.throughput import say
from benchmarks.worker import ROOT, end_tidily

POLL_SECONDS = 0.05


class Arrival(NamedTuple):
    """A record of metrics.jsonl and when it came, in s since the command was given."""

    steps: int
    hits: float  # share of the fights that ended, NaN where none did
    at: float


def main() -> None:
    """Read the flags, train once for every seed, print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--preset", default="solo", help="what is trained (default %(default)s)")
    parser.add_argument(
        "--seeds", type=int, nargs="+", default=[0], help="one training each (default 0)"
    )
    parser.add_argument("--share", type=float, default=0.95, help="of hits (default %(default)s)")
    parser.add_argument(
        "--sustained", type=int, default=10, help="iterations in a row (default %(default)s)"
    )
    parser.add_argument("--json", type=Path, help="write the record to this file, too")
    flags, rest = parser.parse_known_args()
    end_tidily()
    begun, load, trainings = time.monotonic(), Load(), []
    for seed in flags.seeds:
        say(f"training {flags.preset}, seed {seed}")
        trainings.append(
            {"seed": seed, **train(flags.preset, seed, flags.share, flags.sustained, rest)}
        )
    record = provenance() | {
        "preset": flags.preset,
        "flags": rest,
        "share": flags.share,
        "trainings": trainings,
    }
    record |= {
        "repetitions": len(trainings),
        "load": load.cores(),
        "seconds": time.monotonic() - begun,
    }
    if flags.json:
        flags.json.parent.mkdir(parents=True, exist_ok=True)
        flags.json.write_text(json.dumps(record, indent=1) + "\n")
    print(markdown(record))


def train(preset: str, seed: int, share: float, sustained: int, flags: list[str]) -> dict[str, Any]:
    """Train until the skill is there or the run is over; steps and seconds, None where it never
    was.

    RuntimeError where the command fails, and its subclass `patience.Hung` where it hangs.
    """
    with (
        tempfile.TemporaryDirectory(prefix="dronecombat-bench-") as folder,
        tempfile.TemporaryFile("w+") as stderr,
    ):
        output, metrics = Path(folder) / "output", Path(folder) / "runs" / "skill" / "metrics.jsonl"
        command = [
            sys.executable,
            "-m",
            "dronecombat_jax",
            "train",
            "--preset",
            preset,
            "--seed",
            str(seed),
        ]
        command += ["--name", "skill", "--run.directory", str(Path(folder) / "runs")]
        command += ["--run.no-video", "--run.no-replay", "--run.no-figures", *flags]
        begun = time.monotonic()
        with output.open("w") as stdout:
            process = subprocess.Popen(
                command, cwd=ROOT, stdout=stdout, stderr=stderr, env=_unbuffered()
            )
            try:
                arrivals, compiled = _watch(process, output, metrics, begun, share, sustained)
            finally:
                process.kill()
                process.wait()
        if not arrivals:
            stderr.seek(0)
            raise RuntimeError(
                f"training ended (exit code {process.returncode}) without a record:\n{stderr.read()}"
            )
    last, arrived = arrivals[-1], reached(arrivals, share, sustained)
    return {
        "steps": arrived.steps if arrived else None,
        "training_seconds": arrived.at - compiled if arrived else None,
        "seconds": arrived.at if arrived else None,
        "steps_per_second": last.steps / (last.at - compiled),
        "best": max(
            (arrival.hits for arrival in arrivals if arrival.hits == arrival.hits), default=None
        ),
        "curve": [
            [
                arrival.steps,
                round(arrival.hits, 4) if arrival.hits == arrival.hits else None,
                round(arrival.at, 2),
            ]
            for arrival in arrivals
        ],
    }


def reached(arrivals: list[Arrival], share: float, sustained: int) -> Arrival | None:
    """The first record from which on `sustained` in a row have at least `share` hits."""
    row = 0
    for index, arrival in enumerate(arrivals):
        row = row + 1 if arrival.hits >= share else 0
        if row == sustained:
            return arrivals[index - sustained + 1]
    return None


def markdown(record: dict[str, Any]) -> str:
    """A row for every seed, and the medians."""
    rows = []
    for training in record["trainings"]:
        known = training["steps"] is not None
        cells = (
            [
                f"{training['steps']:,}",
                f"{training['training_seconds']:.1f}",
                f"{training['seconds']:.1f}",
            ]
            if known
            else ["never"] * 3
        )
        rows.append(
            [
                f"{record['preset']}, seed {training['seed']}",
                *cells,
                f"{training['steps_per_second']:,.0f}",
            ]
        )
    if len(rows) > 1 and all(training["steps"] is not None for training in record["trainings"]):
        median = lambda key: statistics.median(training[key] for training in record["trainings"])
        cells = [
            f"{median('steps'):,.0f}",
            f"{median('training_seconds'):.1f}",
            f"{median('seconds'):.1f}",
        ]
        rows.append(["median", *cells, f"{median('steps_per_second'):,.0f}"])
    title = f"{record['share']:g} hits"
    header = (
        title,
        "environment steps",
        "seconds of training",
        "seconds from the command",
        "steps/s",
    )
    return "\n\n".join([head(record), table(header, rows)])


def _watch(
    process: subprocess.Popen,
    output: Path,
    metrics: Path,
    begun: float,
    share: float,
    sustained: int,
) -> tuple[list[Arrival], float]:
    """Records as they come until the skill is there or the process ends; and when the first call
    began.
    """
    arrivals: list[Arrival] = []
    compiled, read = 0.0, 0
    watch = Watch(process, "training")
    while True:
        ended = process.poll() is not None  # before the files are read: nothing can come after
        now = time.monotonic() - begun
        if not compiled and any(map(COMPILED.match, output.read_text().splitlines())):
            compiled = now
        if metrics.exists():
            with metrics.open("rb") as file:
                file.seek(read)
                lines = file.read().rpartition(b"\n")[0]
            read += len(lines) + bool(lines)
            if lines:
                watch.heard()
            for line in lines.splitlines():
                record = json.loads(line)
                hits = record["outcome/reached"]
                arrivals.append(
                    Arrival(record["steps"], float("nan") if hits is None else hits, now)
                )
        if ended or reached(arrivals, share, sustained):
            return arrivals, compiled
        watch.check()
        time.sleep(POLL_SECONDS)


def _unbuffered() -> dict[str, str]:
    return {**os.environ, "PYTHONUNBUFFERED": "1"}


if __name__ == "__main__":
    main()
