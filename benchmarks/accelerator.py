"""Training and flying on whatever device JAX finds, by seeds and environments; made for a GPU.

    python -m benchmarks.accelerator
    python -m benchmarks.accelerator --device gpu --training 1x1000 16x1000 1x16000 --flying 1000
    65536 --rounds 3

Every size is a part of the benchmark (`worker`) in a process of its own. They are built side by
side, `--jobs` at a time, since a GPU's compiler uses one core; then they take turns, one alone at a
time, and each gives its best rate. `SEEDSxENVIRONMENTS/K` trains K seeds at a time where another
number is meant than all of them. Prints Markdown tables and writes a JSON file. JAX's own variables
and `XLA_FLAGS` pass through, and are recorded.
"""

import argparse
import json
import os
import re
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from benchmarks.patience import Hung
from benchmarks.record import provenance
from benchmarks.size import TINY, Size
from benchmarks.tables import table
from benchmarks.throughput import say
from benchmarks.worker import Worker, end_tidily

DEFAULT_FILE = Path("build/bench-accelerator.json")
TRAINING = ("1x1000", "4x1000", "16x1000", "64x1000", "1x4000", "1x16000", "1x64000")
FLYING = (1000, 16_000, 256_000)


def main() -> None:
    """Read the flags, measure, print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--device", default="auto", choices=("auto", "cpu", "gpu", "tpu"))
    parser.add_argument("--training", nargs="*", default=TRAINING, metavar="SEEDSxENVIRONMENTS")
    parser.add_argument("--flying", nargs="*", type=int, default=FLYING, metavar="ENVIRONMENTS")
    parser.add_argument(
        "--rounds", type=int, default=3, help="repetitions of everything (default %(default)s)"
    )
    parser.add_argument(
        "--jobs", type=int, default=4, help="processes built at a time (default %(default)s)"
    )
    parser.add_argument(
        "--cache",
        type=Path,
        help="a compile cache to keep and use; compile times are then not cold",
    )
    parser.add_argument(
        "--json", type=Path, default=DEFAULT_FILE, help="the record (default %(default)s)"
    )
    parser.add_argument(
        "--tiny", action="store_true", help="tiny networks and few steps; the figures mean nothing"
    )
    flags = parser.parse_args()
    end_tidily()
    begun = time.monotonic()
    # several processes share the device
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    size = replace(TINY if flags.tiny else Size(), device=flags.device)
    orders = [("iteration", word, trained(size, word)) for word in flags.training]
    orders += [("step", str(count), replace(size, num_envs=count)) for count in flags.flying]
    try:
        record = provenance() | {"device": flags.device, "rows": build_and_measure(orders, flags)}
    except Hung as hung:
        raise SystemExit(f"error: {hung}") from None
    record["seconds"] = time.monotonic() - begun
    flags.json.parent.mkdir(parents=True, exist_ok=True)
    flags.json.write_text(json.dumps(record, indent=1) + "\n")
    print(markdown(record))
    say(f"written to {flags.json}")


def trained(size: Size, word: str) -> Size:
    """The size that `SEEDSxENVIRONMENTS` or `SEEDSxENVIRONMENTS/K` names."""
    if not (match := re.fullmatch(r"(\d+)x(\d+)(?:/(\d+))?", word)):
        raise SystemExit(
            f"error: --training {word}: SEEDSxENVIRONMENTS is wanted, as in 8x1000 or 8x1000/1"
        )
    seeds, environments, at_once = (int(number or 0) for number in match.groups())
    return replace(size, seeds=seeds, num_envs=environments, seeds_at_once=at_once)


def build_and_measure(orders: list[tuple[str, str, Size]], flags: argparse.Namespace) -> list[dict]:
    """A row for each order: what its part reported, and the best rate of each of its programs."""
    with ExitStack() as stack:
        cache = flags.cache and flags.cache.absolute()
        build = lambda order: stack.enter_context(Worker(order[0], order[2], cache))
        say(f"building {len(orders)} programs")
        with ThreadPoolExecutor(flags.jobs) as builders:
            workers = list(builders.map(build, orders))
        rows = [
            {"what": what, "size": word, **worker.ready, "rates": {}}
            for (what, word, _), worker in zip(orders, workers, strict=True)
        ]
        for number in range(flags.rounds):
            say(f"round {number + 1} of {flags.rounds}")
            for row, worker in zip(rows, workers, strict=True):
                for program, rate in worker.repeat().items():
                    row["rates"][program] = max(rate, row["rates"].get(program, 0.0))
    return rows


def markdown(record: dict) -> str:
    """One table for training, one for flying."""
    versions = ", ".join(f"{name} {version}" for name, version in record["versions"].items())
    blocks = [
        f"{record['date']}, commit {record['commit']}, {record['machine']['name']}; {versions}"
    ]
    blocks += [
        f"`{name}={value}`"
        for name, value in record["environment"].items()
        if name.startswith(("XLA_", "JAX_"))
    ]
    for what, title in (("iteration", "seeds x environments"), ("step", "environments")):
        rows = [row for row in record["rows"] if row["what"] == what]
        if not rows:
            continue
        programs = list(rows[0]["rates"])
        lines = [
            [
                row["size"],
                *(f"{row['rates'][name]:,.0f}" for name in programs),
                f"{sum(row['compile_seconds'].values()):.0f}",
                row["facts"]["kind"],
            ]
            for row in rows
        ]
        blocks.append(
            table(
                [title, *(f"{name}: steps/s" for name in programs), "compile, s", "device"], lines
            )
        )
    return "\n\n".join(blocks)


if __name__ == "__main__":
    main()
