"""What `dronecombat runs` prints, and its question before anything is removed. Needs no JAX.

What does not live here: what lies in a folder (`files.inventory`), what may go (`files.prune`).
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from dronecombat_jax.config import estimates
from dronecombat_jax.errors import UserError
from dronecombat_jax.files import prune
from dronecombat_jax.files.inventory import POLICY, RUN, TOURNAMENT, Item, inventory
from dronecombat_jax.machine import backend
from dronecombat_jax.runs.progress import printable
from dronecombat_jax.runs.rate import count_text, share_text

TITLES = {RUN: "runs", TOURNAMENT: "tournaments", POLICY: "policies"}


def show(folder: Path) -> list[Item]:
    """Print what lies in `folder`, and return it."""
    items = inventory(folder)
    print(table(items) or f"{printable(str(folder))}: no run, no tournament, no policy file")
    return items


def table(items: Sequence[Item]) -> str:
    """A table for each kind."""
    blocks = []
    for kind, title in TITLES.items():
        some = [item for item in items if item.kind == kind]
        rows = [
            (title, "state", "progress", "defender / attacker / tie", "size", ""),
            *map(_row, some),
        ]
        if some:
            blocks.append("\n".join(_aligned(rows)))
    return "\n\n".join(blocks)


def tidy(items: list[Item], *, ask: bool, caches: bool) -> None:
    """Say what can go of `items` (and of compiled programs, with `caches`), ask, and remove it.

    Raises UserError 2 where nobody can be asked, 73 where the disk refuses.
    """
    doomed = prune.leftovers(items, backend.cache_dir() if caches else None)
    print()
    if not doomed:
        print("nothing to remove")
        return
    for leftover in doomed:
        size = estimates.bytes_in_words(leftover.size)
        print(f"{printable(str(leftover.path))}  {size}: {leftover.why}")
    total = estimates.bytes_in_words(sum(leftover.size for leftover in doomed))
    if ask and not _agreed(f"remove these {len(doomed)}, {total}? [y/N] "):
        print("nothing was removed")
        return
    kept = [leftover for leftover in doomed if not prune.remove(leftover)]
    for leftover in kept:
        print(f"left alone, another process is at work there: {printable(str(leftover.path))}")
    print(f"removed {len(doomed) - len(kept)}")


def _row(item: Item) -> tuple[str, ...]:
    shares = " / ".join(map(share_text, item.outcomes)) or "-"
    size = estimates.bytes_in_words(item.size)
    return (printable(item.path.name), item.state, _progress(item), shares, size, item.note)


def _progress(item: Item) -> str:
    """Such as "7.20 M of 20.40 M steps, 35 %"."""
    unit = "fights" if item.kind == TOURNAMENT else "steps"
    if not item.total:
        return f"{count_text(item.done)} {unit}" if item.done else "-"
    percent = 100.0 * min(item.done / item.total, 1.0)
    return f"{count_text(item.done)} of {count_text(item.total)} {unit}, {percent:.0f} %"


def _aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    cells = lambda row: (text.ljust(width) for text, width in zip(row, widths, strict=True))
    return ["  ".join(cells(row)).rstrip() for row in rows]


def _agreed(question: str) -> bool:
    """Whether a person says yes; UserError 2 where there is none to ask."""
    if not sys.stdin.isatty():
        raise UserError("nothing was removed: nobody is there to be asked; --yes removes all of it")
    try:
        return input(question).strip().lower() in ("y", "yes")
    except EOFError:
        return False
