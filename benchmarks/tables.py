"""A record as Markdown tables, ready for docs/performance.md.

python -m benchmarks.tables build/bench.json
"""

import argparse
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from benchmarks.results import START_TARGETS
from benchmarks.size import Size, mflop_per_step

ROWS = (
    ("(a) environment alone, one program", "step/environment"),
    ("(a) environment alone, a device per core", "step-cores/environment"),
    ("physics alone, one program", "step/physics"),
    ("physics alone, a device per core", "step-cores/physics"),
    ("plain `mjx.Data` carry, one program", "step/plain data"),
    ("plain `mjx.Data` carry, a device per core", "step-cores/plain data"),
    ("C MuJoCo `mujoco.rollout`, lean model", "mujoco/lean"),
    ("C MuJoCo `mujoco.rollout`, full model", "mujoco/full"),
    ("(b) rollout with policies, one seed", "ippo/flight"),
    ("(b) rollout with policies, two seeds", "ippo-seeds/flight"),
    ("(c) IPPO, one seed", "ippo/iteration"),
    ("(c) IPPO, two seeds", "ippo-seeds/iteration"),
    ("(d) S-IPPO, live chunk", "sippo/live"),
    ("(d) S-IPPO, frozen chunk", "sippo/frozen"),
    ("(d) S-IPPO, a fifth of the chunks frozen", "sippo/mixed"),
    ("(e) tournament fights", "tournament/fights"),
)
TRAINING = ("ippo/iteration", "ippo-seeds/iteration", "sippo/live", "sippo/frozen", "sippo/mixed")
PRODUCTS = (
    ("numpy-1", "NumPy, 1 thread"),
    ("numpy", "NumPy, all"),
    ("xla-1", "XLA, 1 thread"),
    ("xla", "XLA, all"),
)


def markdown(record: dict[str, Any]) -> str:
    """All tables of the record that have rows."""
    parts = (head, _throughput, _ratios, _split, _ceilings, _start)
    return "\n\n".join(text for text in (part(record) for part in parts) if text)


def table(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A Markdown table whose columns line up; the first is text, the others are numbers."""
    lines = [list(header), *map(list, rows)]
    if len(lines) == 1:
        return ""
    widths = [max(len(line[column]) for line in lines) for column in range(len(lines[0]))]
    pad = lambda line: [
        word.ljust(w) if i == 0 else word.rjust(w)
        for i, (word, w) in enumerate(zip(line, widths, strict=False))
    ]
    rule = [
        "-" * width if index == 0 else "-" * (width - 1) + ":" for index, width in enumerate(widths)
    ]
    return "\n".join(
        "| " + " | ".join(cells) + " |" for cells in (pad(lines[0]), rule, *map(pad, lines[1:]))
    )


def spread(figure: dict[str, Any], form: str = ",.0f") -> str:
    """The median, with minimum and maximum in brackets."""
    return f"{figure['median']:{form}} ({figure['min']:{form}} to {figure['max']:{form}})"


def head(record: dict[str, Any]) -> str:
    """What was measured where and when, by what, and who else was busy; one sentence a line."""
    versions = ", ".join(f"{name} {version}" for name, version in record["versions"].items())
    lines = [
        f"{record['date'][:16].replace('T', ' ')} UTC, commit {record['commit']}, {record['machine']['name']}; {versions}."
    ]
    if record.get("load"):
        others, hypervisor = record["load"]["other_processes"], record["load"]["hypervisor"]
        lines.append(
            f"Meanwhile other processes took {others:.2f} cores and the hypervisor {hypervisor:.2f}."
        )
    lines.append(
        f"Median (minimum to maximum) of {record['repetitions']} repetitions; {record['seconds'] / 60:.1f} minutes in all."
    )
    lines += [f"Left out: {message}." for message in record.get("hung", {}).values()]
    blas = record.get("parts", {}).get("numpy", {}).get("facts", {}).get("blas")
    if blas:
        lines.append(f"NumPy's BLAS: {blas}.")
    set_here = ", ".join(f"{key}={value}" for key, value in record["environment"].items())
    if set_here:
        lines.append(
            f"Set in the environment: {set_here} (OPENBLAS_CORETYPE, OPENBLAS_L2_SIZE not where NumPy is measured)."
        )
    return "\n".join(lines)


def _throughput(record: dict[str, Any]) -> str:
    """Rates of all parts; against the matmul floor where products are what bounds them."""
    rows, rates, floor = [], record["rates"], record["floors"].get("matmul")
    for title, name in ROWS:
        if name not in rates:
            continue
        part, program = name.split("/")
        report = record["parts"][part]
        compiled = report["compile_seconds"].get(program)
        if program in ("live", "fights"):
            compiled = next(iter(report["compile_seconds"].values()))
        bound = f"{floor['median']:,.0f}" if floor and name in TRAINING else ""
        share = f"{rates[name]['median'] / floor['median']:.2f}" if bound and floor else ""
        # the process's peak belongs to its first program
        first = name == f"{part}/{next(iter(report['work']))}"
        memory = f"{report['peak_mib']:,.0f} MiB" if first else ""
        rows.append(
            [
                title,
                spread(rates[name]),
                bound,
                share,
                f"{compiled:.1f} s" if compiled else "",
                memory,
            ]
        )
    compiling = "compile, cold" if record["cold"] else "compile, from the cache"
    header = ("", "environment steps/s", "matmul floor", "ratio", compiling, "peak memory")
    return table(header, rows)


def _ratios(record: dict[str, Any]) -> str:
    rows = []
    for name, figure in record["ratios"].items():
        form, least = ",.0f" if name.endswith("steps/s") else ".2f", figure["least"]
        wanted = "" if least is None else f"{least:{form}}"
        verdict = "" if least is None else "yes" if figure["median"] >= least else "no"
        rows.append([name, spread(figure, form), wanted, verdict])
    return table(("", "measured", "at least", "reached"), rows)


def _split(record: dict[str, Any]) -> str:
    """What an iteration is made of."""
    rows = []
    for part, pieces in record["split"].items():
        seeds = record["parts"][part]["facts"]["num_seeds"]
        whole = pieces["iteration"]["median"]
        cells = [
            f"{pieces[name]['median']:,.0f} ({pieces[name]['median'] / whole:.0%})"
            for name in ("physics", "policy", "learning", "rest")
        ]
        rows.append(
            [
                f"{seeds} seed{'s' if seeds > 1 else ''}, {record['parts'][part]['facts']['devices']} devices",
                f"{whole:,.0f}",
                *cells,
            ]
        )
    return table(
        ("milliseconds of an iteration", "all", "physics", "policy", "learning", "rest"), rows
    )


def _ceilings(record: dict[str, Any]) -> str:
    """Products by shape in GFLOP/s, memory in GB/s, and the floors that follow."""
    rates, floors = record["rates"], record["floors"]
    columns = [(part, title) for part, title in PRODUCTS if part in record["parts"]]
    names = list(record["parts"][columns[0][0]]["work"]) if columns else []
    cube = record["size"]["cube"]
    rows = [
        [
            f"{cube} cubed" if name == "cube" else name,
            *(spread(rates[f"{part}/{name}"]) for part, _ in columns),
        ]
        for name in names
    ]
    blocks = [
        table((f"GFLOP/s, batch {_size(record).minibatch}", *(title for _, title in columns)), rows)
    ]
    if "memory/triad" in rates:
        single, every = spread(rates["memory/triad-1"], ".1f"), spread(rates["memory/triad"], ".1f")
        blocks.append(
            f"Memory, triad: {single} GB/s with one thread, {every} GB/s with one per core."
        )
    if floors:
        listed = "; ".join(f"{name}: {spread(figure)}" for name, figure in floors.items())
        blocks.append(
            f"Floors of IPPO at {mflop_per_step(_size(record)):.2f} MFLOP a step, in steps/s: {listed}."
        )
    return "\n\n".join(text for text in blocks if text)


def _start(record: dict[str, Any]) -> str:
    rows = []
    for kind, seconds in record.get("start", {}).items():
        least = START_TARGETS[kind]
        names = ("compiling_at", "compile_seconds", "first_line_at")
        verdict = "yes" if seconds["first_line_at"] <= least else "no"
        rows.append([kind, *(f"{seconds[name]:.1f}" for name in names), f"{least:.0f}", verdict])
    return table(
        (
            "`dronecombat train`, seconds",
            "until it compiles",
            "compiling",
            "first line at",
            "at most",
            "reached",
        ),
        rows,
    )


def _size(record: dict[str, Any]) -> Size:
    return Size(**{**record["size"], "hidden_sizes": tuple(record["size"]["hidden_sizes"])})


def main() -> None:
    """Print the tables of a record."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("record", type=Path, help="what benchmarks.throughput has written")
    print(markdown(json.loads(parser.parse_args().record.read_text())))


if __name__ == "__main__":
    main()
