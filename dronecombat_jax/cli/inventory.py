"""`dronecombat runs`; the listing itself is in `listing`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dronecombat_jax.config import flags
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.setting import setting
from dronecombat_jax.errors import UserError


@dataclass(frozen=True)
class RunsFlags:
    """List the runs, tournaments and policy files of a folder: state, progress, who wins, size.

    A run is running, stopped (the same command goes on), finished, damaged or empty. Such as

        dronecombat runs
        dronecombat runs /data/drones
        dronecombat runs --prune --no-caches
    """

    folder: str = setting(".", "the folder that holds runs/ and tournaments/, or one of these")
    prune: bool = setting(
        False,
        "say what nobody needs, ask, and remove it: half-written left-overs, empty runs, what was "
        "set aside as damaged, compiled programs; never a checkpoint that verifies",
    )
    yes: bool = setting(False, "with --prune: do not ask")
    caches: bool = setting(True, "with --prune: compiled programs, too, of whatever run")


def runs(args: Sequence[str]) -> int:
    """list runs, tournaments and policies: state, progress, size; --prune"""
    given: RunsFlags = flags.read(RunsFlags, args, "dronecombat runs", positional="folder")
    folder = Path(given.folder)
    if not folder.is_dir():
        raise UserError(f"FOLDER {one_line(given.folder)}: no such folder")
    from dronecombat_jax.cli import listing

    items = listing.show(folder)
    if given.prune:
        listing.tidy(items, ask=not given.yes, caches=given.caches)
    return 0
