"""Flying the missing cells of a tournament: progress on the screen, shards on the disk, signals
answered.
"""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.arena.players import Player
from dronecombat_jax.arena.rectangle import Rules
from dronecombat_jax.arena.round_robin import play
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.config.fields import GameConfig
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.errors import EXIT_STOPPED, UserError
from dronecombat_jax.runs.progress import Progress, ProgressUpdate, make_progress
from dronecombat_jax.runs.signals import StopFlag, stop_signals
from dronecombat_jax.tournaments.cells import Pair, write_shard
from dronecombat_jax.types import Cause, Outcome

SAVE_SECONDS = 15.0  # what a kill costs at most, beside the cells that are not complete


class Grid:
    """The outcomes of a tournament so far, [D, A, E], and where new ones are kept."""

    def __init__(
        self,
        folder: Path,
        context: dict[str, Any],
        cause: NDArray[np.int8],
        steps: NDArray[np.int32],
        asked: NDArray[np.bool_],
    ):
        """`folder`, `context`: as in `cells`; `cause` NONE: not flown yet; `asked` [D, A]: the
        cells to be flown.
        """
        self.cause, self.steps, self.asked = cause, steps, asked
        self._folder, self._context = folder, context
        self._pending: list[Pair] = []

    @property
    def flown(self) -> NDArray[np.bool_]:
        """[D, A] cells that are complete."""
        return np.all(self.cause != Cause.NONE, axis=2)

    def add(self, row: int, column: int, pair: Pair) -> None:
        """Take in one cell."""
        self.cause[row, column], self.steps[row, column] = pair.cause, pair.steps
        self._pending.append(pair)

    def save(self) -> None:
        """See what was added since to the disk. UserError 73."""
        write_shard(self._folder, self._context, self._pending)
        self._pending = []


def fly(
    title: str, combat: Combat, sides: Sequence[Sequence[Player | None]], rules: Rules, grid: Grid
) -> bool:
    """Fly all cells asked for that `grid` lacks, between players who are there.

    False where a signal came; then all is saved.
    """
    present = [np.asarray([player is not None for player in side], bool) for side in sides]
    wanted = np.outer(*present) & grid.asked & ~grid.flown
    if not wanted.any():
        return True
    total, done = (int(cells.sum()) * rules.episodes for cells in (wanted, grid.asked & grid.flown))
    with (
        make_progress(title, done + total, done, unit="fights") as progress,
        _stopping(progress) as stop,
    ):
        try:
            _fly(combat, sides, rules, wanted, grid, progress, stop)
        except jax.errors.JaxRuntimeError as error:
            message = f"the device failed ({one_line(str(error))}); what was done is kept, the same command goes on"
            raise UserError(message, EXIT_STOPPED) from error
        finally:
            grid.save()
        complete = bool(np.all(grid.flown[wanted]))
        if stop or not complete:
            fights = int((grid.asked & grid.flown).sum()) * rules.episodes
            progress.message(
                f"stopped after {fights:,} of {done + total:,} fights; the same command goes on"
            )
    return complete and not stop  # a signal may have come after the last look at it


def _fly(
    combat: Combat,
    sides: Sequence[Sequence[Player | None]],
    rules: Rules,
    wanted: NDArray[np.bool_],
    grid: Grid,
    progress: Progress,
    stop: StopFlag,
) -> None:
    indices = [np.flatnonzero(wanted.any(axis=axis)).tolist() for axis in (1, 0)]
    defenders, attackers = (
        [side[i] for i in chosen if side[i]] for side, chosen in zip(sides, indices, strict=True)
    )
    before, fights, saved = progress.last.steps, np.zeros(len(Cause), int), time.monotonic()
    harvests = play(
        combat,
        [player for player in defenders if player],
        [player for player in attackers if player],
        rules,
        wanted[np.ix_(*indices)],
        compiling=progress.compiling,
    )
    for harvest in harvests:
        for row, column, cause, steps in harvest.cells:
            players = defenders[row], attackers[column]
            pair = Pair(
                *(player.identity for player in players if player), cause=cause, steps=steps
            )
            grid.add(indices[0][row], indices[1][column], pair)
        fights += harvest.fights
        progress.update(progress_of(combat.config.game, before, fights))
        if time.monotonic() - saved > SAVE_SECONDS:
            grid.save()
            saved = time.monotonic()
        if stop:
            break


def progress_of(game: GameConfig, before: int, fights: NDArray) -> ProgressUpdate:
    """What the display shows: all fights done, and shares of those flown in this session by `Cause`
    [C].
    """
    total = int(fights.sum())
    winner = np.asarray(outcome_table(game))
    share = lambda chosen: float(fights[chosen].sum() / total) if total else float("nan")
    return ProgressUpdate(
        before + total,
        share(winner == Outcome.DEFENDER),
        share(winner == Outcome.ATTACKER),
        share(winner == Outcome.DRAW),
        share([Cause.DEFENDER_CRASH, Cause.BOTH_CRASH]),
        share([Cause.ATTACKER_CRASH, Cause.BOTH_CRASH]),
    )


@contextmanager
def _stopping(progress: Progress) -> Iterator[StopFlag]:
    announce = lambda name: progress.message(
        f"{name}: saving and stopping; once more to stop at once"
    )
    with stop_signals(announce) as stop:
        yield stop
