"""The part of a round robin that one program can fly: its batches, in the air at once and never
waiting for each other.

What does not live here: the program itself (`lanes`), who sits where (`schedule`), the grid
(`tournament`).
"""

from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.arena.lanes import Lanes, Layout, Orders, Side, build_fly, idle_lanes
from dronecombat_jax.arena.players import Player, content_words, kind_of, scripted_numbers, stack
from dronecombat_jax.arena.schedule import Schedule, tiles
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.types import ATTACKER, DEFENDER, NUM_SIDES, Cause, EnvState, SidePolicy


class Rules(NamedTuple):
    """What all cells of a tournament share."""

    episodes: int = 5
    seed: int = 0
    stochastic: bool = False  # draw the policies' actions instead of taking their mean


class Cell(NamedTuple):
    """All fights between two players, in order of episode."""

    defender: int
    attacker: int
    cause: NDArray[np.int8]  # [E] `Cause`
    steps: NDArray[np.int32]  # [E] control steps flown


class Harvest(NamedTuple):
    """What one call of the program has ended."""

    cells: list[Cell]  # those that are now done
    fights: NDArray[np.integer]  # [C] fights by `Cause`


class Batch(NamedTuple):
    """Lanes on one device and who flies in them."""

    schedule: Schedule
    fly: Callable[..., Lanes]
    lanes: Lanes  # on the device; given away to the next call
    crews: tuple[SidePolicy | None, ...]  # by role: all policies, leaves [P, ...], on the device
    device: Any  # a `jax.Device`


class Rectangle:
    """Players who are `alike` on each side, and the cells `wanted` [D, A] between them."""

    def __init__(
        self,
        combat: Combat,
        sides: tuple[list[Player], list[Player]],
        wanted: NDArray[np.bool_],
        rules: Rules,
        starts: EnvState,
        layout: Layout,
    ):
        """`starts`: the start states of the episodes, NumPy leaves [E, ...]."""
        self._combat, self._sides, self._rules, self._starts, self._layout = (
            combat,
            sides,
            rules,
            starts,
            layout,
        )
        self._kinds = kind_of(sides[DEFENDER]), kind_of(sides[ATTACKER])
        self._scripted = [scripted_numbers(side, role) for role, side in enumerate(sides)]
        self._words = [
            np.stack([content_words(player.identity) for player in side]) for side in sides
        ]
        self._queue = tiles(wanted, layout, rules.episodes)
        self._fights = int(wanted.sum()) * rules.episodes
        self._left = np.where(wanted, rules.episodes, 0)
        self._cause = np.zeros((*wanted.shape, rules.episodes), np.int8)
        self._steps = np.zeros((*wanted.shape, rules.episodes), np.int32)
        self._batches: list[Batch] = []

    @property
    def title(self) -> str:
        """Such as "35-256-128-4 against scripted pilots"."""
        return " against ".join(
            "-".join(map(str, kind.sizes)) or "scripted pilots" for kind in self._kinds
        )

    def prepare(self, per_device: int) -> None:
        """Bring the players to the devices, and compile for each of them."""
        fly = jax.jit(
            build_fly(self._combat, self._kinds, self._layout, self._rules.stochastic),
            donate_argnums=0,
        )
        idle, needed = (
            idle_lanes(self._combat, self._kinds, self._layout),
            -(-self._fights // self._layout.lanes),
        )
        nobody = np.zeros(self._layout.lanes, bool)
        for device in jax.local_devices()[:needed]:
            crews = tuple(jax.device_put(stack(side), device) for side in self._sides)
            compiled: Any = None
            for _ in range(min(per_device, needed)):
                schedule = Schedule(
                    self._layout, self._queue, [number < 0 for number in self._scripted]
                )
                batch = Batch(schedule, fly, jax.device_put(idle, device), crews, device)
                if compiled is None:
                    compiled = fly.lower(
                        batch.lanes, *self._inputs(batch, self._orders(schedule, nobody))
                    ).compile()
                self._batches.append(batch._replace(fly=compiled))

    def fly(self) -> Iterator[Harvest]:
        """Keep every batch in the air until all fights are over."""
        # A thread for each: what one thread dispatches to a CPU runs one after the other.
        with ThreadPoolExecutor(len(self._batches)) as pool:
            flying = {
                pool.submit(self._call, batch, self._board(batch.schedule)): batch
                for batch in self._batches
            }
            while flying:
                for future in wait(flying, return_when=FIRST_COMPLETED).done:
                    lanes, cause, steps = future.result()
                    batch = flying.pop(future)._replace(lanes=lanes)
                    harvest = self._harvest(batch.schedule, cause, steps)
                    orders = self._board(batch.schedule)
                    if batch.schedule.busy.any():
                        flying[pool.submit(self._call, batch, orders)] = batch
                    yield harvest

    def _call(self, batch: Batch, orders: Orders) -> tuple[Lanes, NDArray, NDArray]:
        """One call of the program, on a thread of its own; causes and steps [L] once it is done."""
        lanes = batch.fly(batch.lanes, *self._inputs(batch, orders))
        return lanes, np.asarray(lanes.result.cause), np.asarray(lanes.result.steps)

    def _board(self, schedule: Schedule) -> Orders:
        """Fill the free lanes."""
        return self._orders(schedule, schedule.fill())

    def _orders(self, schedule: Schedule, begin: NDArray) -> Orders:
        words = [self._words[role][schedule.player[role]] for role in range(NUM_SIDES)]
        start = jax.tree.map(lambda leaf: leaf[schedule.episode], self._starts)
        seed: Any = np.uint32(self._rules.seed)
        every: Any = (begin, start, np.concatenate(words, axis=1), schedule.episode.copy(), seed)
        return Orders(*every)  # NumPy until it is on the device

    def _inputs(self, batch: Batch, orders: Orders) -> tuple[Orders, tuple[Side, ...]]:
        """`orders` and who flies, on the batch's device."""
        sides = []
        for role, crew in enumerate(batch.crews):
            blocks = batch.schedule.blocks(role)
            pilot = self._scripted[role][batch.schedule.player[role]]
            policies = (
                None if crew is None else _take(crew, jax.device_put(blocks.player, batch.device))
            )
            every: Any = (policies, blocks.rows, blocks.seat, pilot)
            sides.append(Side(*every))
        return jax.device_put((orders, tuple(sides)), batch.device)

    def _harvest(self, schedule: Schedule, cause: NDArray, steps: NDArray) -> Harvest:
        """Take the fights that ended out of their lanes, and find the cells that this completes."""
        ended = schedule.busy & (cause != Cause.NONE)
        fights = np.bincount(cause[ended], minlength=len(Cause))
        where = schedule.take_out(ended)
        if not ended.any():
            return Harvest([], fights)
        self._cause[where], self._steps[where] = cause[ended], steps[ended]
        np.subtract.at(self._left, where[:2], 1)
        touched = np.unique(np.stack(where[:2]), axis=1).T.tolist()
        done = [(row, column) for row, column in touched if self._left[row, column] == 0]
        return Harvest(
            [Cell(*cell, self._cause[cell].copy(), self._steps[cell].copy()) for cell in done],
            fights,
        )


@jax.jit
def _take(crew: SidePolicy, player: jax.Array) -> SidePolicy:
    """The policy of each block, leaves [blocks, ...]."""
    return jax.tree.map(lambda leaf: leaf[player], crew)
