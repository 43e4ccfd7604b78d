"""What may be removed from a folder without a loss: left-overs, what is empty, what was set aside.

Never a checkpoint that verifies or a past player, never anything of a run or tournament that
another process works on. Needs no JAX.
"""

import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from dronecombat_jax.errors import UserError
from dronecombat_jax.files.atomic import TEMPORARY_PREFIX, cannot_write
from dronecombat_jax.files.inventory import (
    CELLS,
    EMPTY,
    RUN,
    RUNNING,
    Item,
    is_run,
    is_tournament,
    size_of,
)
from dronecombat_jax.files.lock import LOCK_NAME, exclusive_lock

SET_ASIDE = "damaged-"  # checkpoints and cells that did not verify, and were renamed
CACHES = ("xla", "lowered")  # in the folder of compiled programs


class Leftover(NamedTuple):
    """Something that nobody needs."""

    path: Path
    why: str
    size: int  # bytes
    owner: Path | None = None  # the run or tournament that must be at rest while it is removed


def leftovers(items: list[Item], cache: Path | None = None) -> list[Leftover]:
    """What can go of `items` (`inventory`) and of the `cache` of compiled programs."""
    doomed = [each for item in items if item.state != RUNNING for each in _of(item)]
    programs = [] if cache is None else [cache / name for name in CACHES]
    why = "compiled programs: made anew when they are needed, which takes a minute"
    return doomed + [Leftover(path, why, size_of(path)) for path in programs if path.is_dir()]


def remove(leftover: Leftover) -> bool:
    """Remove it; False where another process has taken its run or tournament since.

    Raises UserError 73 where the disk refuses.
    """
    path = leftover.path
    if not os.path.lexists(path):
        return True
    with ExitStack() as stack:
        if leftover.owner is not None:
            try:
                stack.enter_context(exclusive_lock(leftover.owner))
            except UserError:
                return False
            if path == leftover.owner and not _nothing_in(path):
                return False  # it has begun since
        try:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()
        except OSError as error:
            raise cannot_write(path, error) from error
    return True


def _of(item: Item) -> Iterator[Leftover]:
    """The left-overs of one run or tournament."""
    path = item.path
    if path.is_symlink() or not (is_run(path) or is_tournament(path)):
        return
    if item.state == EMPTY and _nothing_in(path):
        yield Leftover(path, f"an empty {item.kind}: nothing was ever saved in it", item.size, path)
        return
    below = ("checkpoints", "checkpoints/players", "figures") if item.kind == RUN else (CELLS,)
    for folder in (path, *(path / name for name in below)):
        for entry in sorted(folder.iterdir()) if folder.is_dir() else ():
            if entry.name.startswith(TEMPORARY_PREFIX):
                yield Leftover(entry, "half written by a process that died", size_of(entry), path)
            elif entry.name.startswith(SET_ASIDE) and folder != path:
                yield Leftover(entry, "did not verify, and was set aside", size_of(entry), path)


def _nothing_in(path: Path) -> bool:
    """Whether a folder holds no file but settings, a lock, and what was half written."""
    for folder, names, files in os.walk(path):
        names[:] = [name for name in names if not name.startswith(TEMPORARY_PREFIX)]
        for name in files:
            ours = name in (LOCK_NAME, "config.toml") or name.startswith(TEMPORARY_PREFIX)
            if not ours and os.path.getsize(os.path.join(folder, name)):
                return False
    return True
