"""Throughput side by side with this machine's own ceilings and with references, all in one run of
about five minutes.

    make bench
    python -m benchmarks.throughput [--rounds 5] [--only PART ...] [--json FILE]

Every part lives in a process of its own (`worker`), built one after the other with a cold compile
cache. Then rounds: in each of them every part runs once, every other round in reverse order. All
ratios are of figures of the same round, so that a shared host's drift hits both sides; medians,
minima and maxima are over rounds. A part that hangs is killed (`patience`), named and left out of
the rest, and the exit code is then 1. Prints the tables of docs/performance.md and writes
everything to a JSON file. Needs about 8 GiB of free memory.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from benchmarks import tables
from benchmarks.patience import Hung
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


def main() -> int:
    """Read the flags, measure, print the tables; 0 if no part has hung."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--rounds", type=int, default=5, help="repetitions of everything (default %(default)s)"
    )
    parser.add_argument(
        "--only", nargs="+", choices=PARTS, default=PARTS, metavar="PART", help=", ".join(PARTS)
    )
    parser.add_argument(
        "--json", type=Path, default=DEFAULT_FILE, help="the record (default %(default)s)"
    )
    parser.add_argument(
        "--cache",
        type=Path,
        help="a compile cache to keep and use; compile times are then not cold",
    )
    parser.add_argument(
        "--tiny", action="store_true", help="seconds instead of minutes; the figures mean nothing"
    )
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
    say(
        f"written to {flags.json}; python -m benchmarks.tables {flags.json} prints the tables again"
    )
    return 1 if record["hung"] else 0


def measure(parts: list[str], size: Size, rounds: int, cache: Path | None = None) -> dict[str, Any]:
    """The whole record: provenance, what every part reported and every rate of every round, and
    what follows from it.
    """
    begun, load = time.monotonic(), Load()
    record = provenance() | {
        "size": json.loads(size.to_json()),
        "cold": cache is None,
        "repetitions": rounds,
        "hung": {},
        "parts": {},
        "rounds": [],
    }
    if START in parts:
        say("start of dronecombat train, cold and warm")
        with going_on(record, START):
            record["start"] = starts()
    with ExitStack() as stack:
        workers: list[Worker] = []
        for name in parts:
            if name != START:
                say(f"building {name}")
                with going_on(record, name):
                    workers.append(stack.enter_context(Worker(name, size, cache)))
                    record["parts"][name] = workers[-1].ready
        for number in range(rounds if workers else 0):
            say(f"round {number + 1} of {rounds}")
            record["rounds"].append({})
            for worker in workers if number % 2 == 0 else reversed(workers):
                take_turn(record, worker)
    record["load"] = load.cores()
    record["seconds"] = time.monotonic() - begun
    return record | derive(record)


def take_turn(record: dict[str, Any], worker: Worker) -> None:
    """Let a part that has not hung run once, for the last round of the record."""
    if worker.name in record["hung"]:
        return
    with going_on(record, worker.name):
        rates = worker.repeat()
        record["rounds"][-1] |= {f"{worker.name}/{name}": rate for name, rate in rates.items()}


@contextmanager
def going_on(record: dict[str, Any], part: str) -> Iterator[None]:
    """Go on without a part that hangs: the record then says so, and keeps none of its figures."""
    try:
        yield
    except Hung as hung:
        say(f"{hung}: left out")
        record["hung"][part] = str(hung)
        record["parts"].pop(part, None)
        for rates in record["rounds"]:
            for name in [name for name in rates if name.startswith(f"{part}/")]:
                del rates[name]


def say(text: str) -> None:
    """Progress: stdout is for the tables."""
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
