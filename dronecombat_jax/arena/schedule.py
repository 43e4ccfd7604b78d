"""Who flies where in one batch of a round robin: the waiting fights, the lanes they take, the
blocks of one policy.

NumPy on the host, between two calls of the program (`lanes`). Nothing in here can change an
outcome.
"""

import math
from collections import deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.arena.lanes import Layout
from dronecombat_jax.types import ATTACKER, DEFENDER, NUM_SIDES

NOBODY = -1


class Fight(NamedTuple):
    """One fight of the grid, by index."""

    defender: int
    attacker: int
    episode: int


class Blocks(NamedTuple):
    """One side's lanes, grouped by player."""

    player: NDArray[np.integer]  # [blocks] whose policy flies the block; 0 for an empty one
    rows: NDArray[np.integer]  # [blocks, block] the lane on each seat; 0 on an empty one
    # [L] the seat of each lane, counted through all blocks; 0 for a lane without one
    seat: NDArray[np.integer]


def tiles(wanted: NDArray[np.bool_], layout: Layout, episodes: int) -> Iterator[deque[Fight]]:
    """The fights of all cells `wanted` [D, A], in squares of about as many fights as a batch has
    lanes.

    A square has few players, so that most blocks are full.
    """
    side = max(1, math.ceil(math.sqrt(layout.lanes / episodes)))
    for row in range(0, wanted.shape[0], side):
        for column in range(0, wanted.shape[1], side):
            cells = np.argwhere(wanted[row : row + side, column : column + side]).tolist()
            if cells:
                yield deque(
                    Fight(row + d, column + a, e) for d, a in cells for e in range(episodes)
                )


class Schedule:
    """The lanes of one batch; takes tiles from `queue`, which batches share."""

    def __init__(
        self, layout: Layout, queue: Iterator[deque[Fight]], grouped: Sequence[NDArray[np.bool_]]
    ):
        """`grouped` by role, [D] and [A]: whose lanes sit in blocks (those of policies)."""
        self.layout, self._queue, self._grouped = layout, queue, grouped
        self._waiting: deque[Fight] = deque()
        self.player = np.full((NUM_SIDES, layout.lanes), NOBODY)
        self.episode = np.zeros(layout.lanes, np.int32)
        self._flying: list[dict[int, int]] = [{} for _ in range(NUM_SIDES)]  # lanes by player
        self._used = [0] * NUM_SIDES  # blocks

    @property
    def busy(self) -> NDArray[np.bool_]:
        """[L] lanes with a fight that has not been taken out."""
        return self.player[DEFENDER] != NOBODY

    def take_out(self, ended: NDArray[np.bool_]) -> tuple[NDArray, NDArray, NDArray]:
        """Free the lanes `ended` [L]; defenders, attackers and episodes [n] of the fights that were
        there.
        """
        lanes = np.flatnonzero(ended)
        for role in range(NUM_SIDES):
            for player in self.player[role, lanes].tolist():
                self._count(role, player, -1)
        out = (*self.player[:, lanes], self.episode[lanes])
        self.player[:, lanes] = NOBODY
        return out

    def fill(self) -> NDArray[np.bool_]:
        """Seat waiting fights in free lanes while their players' blocks have room; [L] lanes that
        begin.
        """
        begin = np.zeros(self.layout.lanes, bool)
        for lane in np.flatnonzero(~self.busy):
            if not self._waiting:
                self._waiting = next(self._queue, deque())
            if not self._waiting or not self._room(self._waiting[0]):
                break
            fight = self._waiting.popleft()
            for role in range(NUM_SIDES):
                self._count(role, fight[role], 1)
            self.player[:, lane] = fight[: ATTACKER + 1]
            self.episode[lane], begin[lane] = fight.episode, True
        return begin

    def blocks(self, role: int) -> Blocks:
        """Group the busy lanes that sit in blocks by player."""
        layout, player = self.layout, self.player[role]
        lanes = np.flatnonzero((player != NOBODY) & self._grouped[role][player])
        lanes = lanes[np.argsort(player[lanes], kind="stable")]
        flyers, first, count = np.unique(player[lanes], return_index=True, return_counts=True)
        needed = -(-count // layout.block)
        start = np.cumsum(needed) - needed  # each player's first block
        seat = np.repeat(start * layout.block - first, count) + np.arange(len(lanes))
        rows = np.zeros(layout.blocks * layout.block, np.int32)
        rows[seat] = lanes
        seats = np.zeros(layout.lanes, np.int32)
        seats[lanes] = seat
        players = np.zeros(layout.blocks, np.int32)
        players[: needed.sum()] = np.repeat(flyers, needed)
        return Blocks(players, rows.reshape(layout.blocks, layout.block), seats)

    def _room(self, fight: Fight) -> bool:
        return all(
            not self._grouped[role][fight[role]]
            or self._used[role] < self.layout.blocks
            or self._flying[role].get(fight[role], 0) % self.layout.block
            for role in range(NUM_SIDES)
        )

    def _count(self, role: int, player: int, change: int) -> None:
        if not self._grouped[role][player]:
            return
        before = self._flying[role].get(player, 0)
        self._flying[role][player] = before + change
        self._used[role] += -(-(before + change) // self.layout.block) - -(
            -before // self.layout.block
        )
