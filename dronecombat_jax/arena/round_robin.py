"""The round robin: every attacker against every defender, E fights a cell, cell by cell as they are
done.

Fights wait in a queue for the lanes of small batches; a batch flies a few control steps in one call
of a compiled program, then the fights that ended give up their lanes. An outcome depends on the two
players, the episode and the seed, and not on batches, devices, cores, order or who else takes part.
What does not live here: where players come from and where results go (`runs`), ratings.
"""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.arena.lanes import Layout, start_states
from dronecombat_jax.arena.players import Player, alike
from dronecombat_jax.arena.rectangle import Harvest, Rectangle, Rules
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.machine import backend

# Lanes that fit a core's cache, blocks that are nearly full: benchmarks/tournament.py. An
# accelerator wants width.
CPU_LAYOUT = Layout(lanes=512, block=16, blocks=44)
ACCELERATOR_LAYOUT = Layout(lanes=8192, block=32, blocks=384)
ACCELERATOR_BATCHES = 2  # one flies while the host harvests the other

Compiling = Callable[[str], AbstractContextManager[Any]]


def play(
    combat: Combat,
    defenders: Sequence[Player],
    attackers: Sequence[Player],
    rules: Rules,
    wanted: NDArray[np.bool_] | None = None,
    *,
    layout: Layout | None = None,
    batches: int | None = None,
    compiling: Compiling = lambda what: nullcontext(),
) -> Generator[Harvest, None, None]:
    """Fly the cells `wanted` [D, A] (default: all); one `Harvest` a call, so that the caller may
    stop between two.

    `batches` in the air on each device; by default as many as there are cores. `compiling` is
    entered to compile.
    """
    wanted = np.ones((len(defenders), len(attackers)), bool) if wanted is None else wanted
    begin = jax.jit(lambda seed: start_states(combat, seed, rules.episodes))
    starts = jax.device_get(begin(np.uint32(rules.seed)))
    for rows, columns in _rectangles(defenders, attackers, wanted):
        sides = [defenders[row] for row in rows], [attackers[column] for column in columns]
        cells = wanted[np.ix_(rows, columns)]
        rectangle = Rectangle(combat, sides, cells, rules, starts, layout or default_layout())
        with compiling(rectangle.title):
            rectangle.prepare(batches or _batches_per_device())
        for harvest in rectangle.fly():
            yield harvest._replace(
                cells=[
                    cell._replace(defender=rows[cell.defender], attacker=columns[cell.attacker])
                    for cell in harvest.cells
                ]
            )


def default_layout() -> Layout:
    """The static shapes that suit the device."""
    return CPU_LAYOUT if jax.default_backend() == "cpu" else ACCELERATOR_LAYOUT


def _batches_per_device() -> int:
    if jax.default_backend() != "cpu":
        return ACCELERATOR_BATCHES
    return max(1, backend.cores() // jax.local_device_count())


def _rectangles(
    defenders: Sequence[Player], attackers: Sequence[Player], wanted: NDArray
) -> Iterator[tuple[list[int], list[int]]]:
    """The indices of both sides in each part of the grid that one program can fly."""
    for rows in alike(defenders):
        for columns in alike(attackers):
            cells = wanted[np.ix_(rows, columns)]
            if cells.any():  # without the players who have flown all of theirs
                yield (
                    [
                        row
                        for row, some in zip(rows, np.atleast_1d(cells.any(axis=1)), strict=True)
                        if some
                    ],
                    [
                        column
                        for column, some in zip(
                            columns, np.atleast_1d(cells.any(axis=0)), strict=True
                        )
                        if some
                    ],
                )
