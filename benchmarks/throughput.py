"""Throughput side by side with this machine's own ceilings and with references, all in one run of about five minutes.

    make bench
    python -m benchmarks.throughput [--rounds 5] [--only PART ...] [--json FILE]

Every part lives in a process of its own (`worker`), built one after the other with a cold compile cache. Then rounds:
in each of them every part runs once, every other round in reverse order. All ratios are of figures of the same round,
so that a shared host's drift hits both sides; medians, minima and maxima are over rounds. Prints the tables of
docs/performance.md and writes everything to a JSON file. Needs about 8 GiB of free memory.
"""

import argparse
import json
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from benchmarks import tables
from benchmarks.record import Load, provenance
from benchmarks.results import derive
from benchmarks.size import TINY, Size
from benchmarks.start import starts
from benchmarks.worker import Worker, end_tidily

START = "start"
PARTS = (
    *("numpy", "numpy-1", "xla", "xla-1", "memory", "mujoco", "step", "step-cores"),
    *("ippo", "ippo-seeds", "sippo", "tournament", START),
)
DEFAULT_FILE = Path("build/bench.json")


def main() -> None:
    """Read the flags, measure, print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5, help="repetitions of everything (default %(default)s)")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--json", type=Path, default=DEFAULT_FILE, help="the record (default %(default)s)")
    parser.add_argument("--cache", type=Path, help="a compile cache to keep and use; compile times are then not cold")
    parser.add_argument("--tiny", action="store_true", help="seconds instead of minutes; the figures mean nothing")
    flags = parser.parse_args()
    end_tidily()
    if flags.rounds < 1:
        parser.error("--rounds must be at least 1")
    cache = flags.cache and flags.cache.absolute()
    parts = [part for part in PARTS if part in flags.only]
    record = measure(parts, TINY if flags.tiny else Size(), flags.rounds, cache)
    flags.json.parent.mkdir(parents=True, exist_ok=True)
    flags.json.write_text(json.dumps(record, indent=1) + "\n")
    print(tables.markdown(record))
    say(f"written to {flags.json}; python -m benchmarks.tables {flags.json} prints the tables again")


def measure(parts: list[str], size: Size, rounds: int, cache: Path | None = None) -> dict[str, Any]:
    """The whole record: provenance, what every part reported and every rate of every round, and what follows from it."""
    begun, load = time.monotonic(), Load()
    record = provenance() | {
        "size": json.loads(size.to_json()),
        "cold": cache is None,
        "repetitions": rounds,
        "parts": {},
        "rounds": [],
    }
    if START in parts:
        say("start of dronecombat train, cold and warm")
        record["start"] = starts()
    with ExitStack() as stack:
        workers = []
        for name in parts:
            if name != START:
                say(f"building {name}")
                workers.append(stack.enter_context(Worker(name, size, cache)))
                record["parts"][name] = workers[-1].ready
        for number in range(rounds if workers else 0):
            say(f"round {number + 1} of {rounds}")
            rates = {}
            for worker in workers if number % 2 == 0 else reversed(workers):
                rates |= {f"{worker.name}/{program}": rate for program, rate in worker.repeat().items()}
            record["rounds"].append(rates)
    record["load"] = load.cores()
    record["seconds"] = time.monotonic() - begun
    return record | derive(record)


def say(text: str) -> None:
    """Progress: stdout is for the tables."""
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
