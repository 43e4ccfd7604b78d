"""How time and memory grow with environments, seeds, past players and entrants of a tournament.

    make bench-scaling
    python -m benchmarks.scaling [--only environments seeds pool tournament] [--json FILE]

Every size is a part of the benchmark (`worker`) at another size, in a process of its own, one after
the other: its programs are compiled, called once and then repeated. Peak memory is that of the
process, compiler and all. Sizes that need more memory than there is, and sizes that hang
(`patience`), are left out and named; the exit code is 1 where a size has hung. Prints Markdown
tables and writes a JSON file.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.patience import Hung
from benchmarks.record import Load, provenance, summary
from benchmarks.size import TINY, Size
from benchmarks.tables import head, spread, table
from benchmarks.throughput import say
from benchmarks.worker import Worker, end_tidily
from dronecombat_jax.config.estimates import machine_bytes

DEFAULT_FILE = Path("build/bench-scaling.json")


class Sweep(NamedTuple):
    """One table: `values` of a quantity, and the part and size that measure each."""

    title: str
    values: tuple[int, ...]
    part: str
    sized: Callable[[Size, int], Size]
    mib_each: float  # a rough upper bound of what one more takes: what cannot fit is not begun


SWEEPS = {
    "environments": Sweep(
        "environments",
        (250, 500, 1000, 2000, 4000, 8000, 16_000),
        "iteration",
        lambda size, n: replace(size, num_envs=n, seeds=1),
        0.3,
    ),
    "seeds": Sweep(
        "seeds", (1, 2, 4, 8), "iteration", lambda size, n: replace(size, seeds=n), 300.0
    ),
    "pool": Sweep(
        "past players", (1, 10, 100, 1000), "sippo-pool", lambda size, n: replace(size, pool=n), 1.0
    ),
    "pool-environment": Sweep(
        "past players, one drawn for each environment",
        (1, 10, 100, 1000),
        "sippo-pool-environment",
        lambda size, n: replace(size, pool=n),
        1.0,
    ),
    "tournament": Sweep(
        "policies on each side",
        (10, 20, 50, 100),
        "tournament",
        lambda size, n: replace(size, players=n, episodes=2),
        4.0,
    ),
}


def main() -> int:
    """Read the flags, measure, print the tables; 0 if nothing has hung."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only",
        nargs="+",
        choices=SWEEPS,
        default=list(SWEEPS),
        metavar="SWEEP",
        help=", ".join(SWEEPS),
    )
    parser.add_argument("--most", type=int, help="leave out larger values")
    parser.add_argument(
        "--repetitions", type=int, default=2, help="of every size (default %(default)s)"
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
        "--tiny", action="store_true", help="tiny networks and few steps; the figures mean nothing"
    )
    flags = parser.parse_args()
    end_tidily()
    if flags.repetitions < 1:
        parser.error("--repetitions must be at least 1")
    begun, load, cache = time.monotonic(), Load(), flags.cache and flags.cache.absolute()
    record = provenance() | {"cold": cache is None, "repetitions": flags.repetitions, "sweeps": {}}
    for name in flags.only:
        values = [
            value for value in SWEEPS[name].values if flags.most is None or value <= flags.most
        ]
        size = TINY if flags.tiny else Size()
        record["sweeps"][name] = [
            measure(name, size, value, flags.repetitions, cache) for value in values
        ]
    record |= {"load": load.cores(), "seconds": time.monotonic() - begun}
    flags.json.parent.mkdir(parents=True, exist_ok=True)
    flags.json.write_text(json.dumps(record, indent=1) + "\n")
    print(markdown(record))
    say(f"written to {flags.json}")
    return 1 if any(row.get("hung") for rows in record["sweeps"].values() for row in rows) else 0


def measure(
    name: str, size: Size, value: int, repetitions: int, cache: Path | None = None
) -> dict[str, Any]:
    """One size: rates of its programs, seconds to compile, peak memory; or why it was left out."""
    sweep, memory = SWEEPS[name], machine_bytes()
    say(f"{sweep.title}: {value}")
    if memory is not None and value * sweep.mib_each * 2**20 > 0.8 * memory:
        return {"value": value, "left_out": "would not fit into this machine's memory"}
    try:
        with Worker(sweep.part, sweep.sized(size, value), cache) as worker:
            rates = [worker.repeat() for _ in range(repetitions)]
            ready = worker.ready
    except Hung as hung:
        say(str(hung))
        return {"value": value, "left_out": str(hung), "hung": True}
    return {
        "value": value,
        **ready,
        "rates": {key: summary([rate[key] for rate in rates]) for key in rates[0]},
    }


def markdown(record: dict[str, Any]) -> str:
    """A table for every sweep."""
    return "\n\n".join(
        [head(record), *(_table(name, rows) for name, rows in record["sweeps"].items())]
    )


def _table(name: str, rows: list[dict[str, Any]]) -> str:
    """Rates, compile time and memory by value; how an iteration's time grows where rates alone
    would not tell.
    """
    programs = next((list(row["rates"]) for row in rows if "rates" in row), [])
    lines = []
    for row in rows:
        if "left_out" in row:
            lines.append([f"{row['value']:,}", *["" for _ in programs], "", row["left_out"], ""])
            continue
        first = programs[0]
        seconds = row["work"][first] / row["rates"][first]["median"]
        cells = [spread(row["rates"][program]) for program in programs]
        compiled = sum(row["compile_seconds"].values())
        lines.append(
            [
                f"{row['value']:,}",
                *cells,
                f"{seconds:.2f}",
                f"{compiled:.1f}",
                f"{row['peak_mib']:,.0f}",
            ]
        )
    header = [SWEEPS[name].title, *(f"{program}: steps/s" for program in programs)]
    return table([*header, "seconds a call", "compile, s", "peak memory, MiB"], lines)


if __name__ == "__main__":
    sys.exit(main())
