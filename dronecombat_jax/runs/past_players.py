"""The past players of a self-play run on the disk: each stored once, however many checkpoints need
it.

    checkpoints/players/12.safetensors   who was saved when chunk 12 began: the policies of all
    seeds, by role

A checkpoint holds no pool but a `Roster`: how many past players it needs, and one digest over all
of them. So a run's disk grows by one player a chunk, and old checkpoints can go. A file that is
damaged or missing is made again from the checkpoint of that chunk's start, where it is still there.
What does not live here: what a pool is (`selfplay.pool`).
"""

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from dronecombat_jax.files import tensorfile
from dronecombat_jax.files.arrays import Arrays, flatten, paths, unflatten
from dronecombat_jax.files.atomic import cannot_write, write_atomic
from dronecombat_jax.files.manifest import CheckpointError, Roster, state_digest
from dronecombat_jax.files.tensorfile import PolicyError
from dronecombat_jax.types import SIDES

if TYPE_CHECKING:
    from dronecombat_jax.learn.mates import Both
    from dronecombat_jax.types import SelfPlay, SidePolicy, TrainState

FOLDER = "players"


class Players:
    """The files of one run's past players; remembers which of them are known to be good."""

    def __init__(self, checkpoints: Path):
        self._folder = checkpoints / FOLDER
        # of slots 0, 1, ... that this object has written or found good
        self._digests: list[str] = []

    def store(self, state: "TrainState", filled: int) -> tuple["TrainState", Roster | None]:
        """See slots below `filled` of the pools to the disk; the state without pools, and the
        roster it needs.

        `state`: NumPy leaves [S, ...]. Raises UserError 73 where the disk refuses.
        """
        if state.selfplay is None:
            return state, None
        for slot in range(len(self._digests), filled):
            arrays = _named(state.selfplay, lambda role, pool, slot=slot: _at(pool.policies, slot))
            if self._digest(slot) != state_digest(arrays):
                self._write(slot, arrays)
            self._digests.append(state_digest(arrays))
        return state.replace(selfplay=emptied(state.selfplay)), _roster(self._digests[:filled])

    def read(self, roster: Roster) -> list[Arrays]:
        """Every player of `roster`, proven; raises CheckpointError that names the first that is
        wrong.
        """
        members = [self._read(slot) for slot in range(roster.slots)]
        if _roster(state_digest(arrays) for arrays in members) != roster:
            raise CheckpointError(
                f"{self._folder}: these are not the past players that the checkpoint was saved with"
            )
        return members

    def damaged(self, roster: Roster) -> list[int]:
        """Slots of `roster` whose file is missing or unsound."""
        return [slot for slot in range(roster.slots) if self._digest(slot) is None]

    def mend(self, slot: int, selfplay: "SelfPlay", live: "Both") -> None:
        """Write slot `slot` again from the checkpoint of that chunk's start: its `live` policies,
        NumPy leaves [S, ...].
        """
        self._write(slot, _named(selfplay, lambda role, _: live[role]))

    def _write(self, slot: int, arrays: Arrays) -> None:
        try:
            # not its parents: a run that was moved away must not come back empty
            self._folder.mkdir(exist_ok=True)
        except OSError as error:
            raise cannot_write(self._folder, error) from error
        text = {"slot": str(slot), "sha256": state_digest(arrays)}
        write_atomic(self._path(slot), tensorfile.encode(arrays, text))

    def _read(self, slot: int) -> Arrays:
        try:
            arrays, text = tensorfile.read(self._path(slot))
        except PolicyError as error:
            raise CheckpointError(error.message) from None
        if text != {"slot": str(slot), "sha256": state_digest(arrays)}:
            raise CheckpointError(
                f"{self._path(slot)} is damaged: its sha256 does not match its content"
            )
        return arrays

    def _digest(self, slot: int) -> str | None:
        """Digest of a sound file; None where there is none."""
        try:
            return state_digest(self._read(slot))
        except CheckpointError:
            return None

    def _path(self, slot: int) -> Path:
        return self._folder / f"{slot}.safetensors"


def emptied(selfplay: "SelfPlay") -> "SelfPlay":
    """The state with pools that hold nobody, leaves [S, 0, ...]: arrays, or their shapes. Records
    of wins stay.
    """

    def empty(leaf: Any) -> Any:
        shape = (leaf.shape[0], 0, *leaf.shape[2:])
        return (
            np.zeros(shape, leaf.dtype)
            if isinstance(leaf, np.ndarray)
            else leaf.update(shape=shape)
        )

    pools = tuple(
        None if pool is None else pool.replace(policies=jax.tree.map(empty, pool.policies))
        for pool in selfplay.pools
    )
    return selfplay.replace(pools=pools)


def with_players(selfplay: "SelfPlay", members: list[Arrays]) -> "SelfPlay":
    """The pools of `emptied` with `members` in their first slots; as many slots as records of wins."""

    def filled(role: int, pool: Any) -> Any:
        leaves = []
        for name, empty in paths({SIDES[role]: pool.policies}):
            whole = np.zeros((empty.shape[0], pool.games.shape[1], *empty.shape[2:]), empty.dtype)
            for slot, arrays in enumerate(members):
                whole[:, slot] = arrays[name.replace("/", ".")]
            leaves.append(whole)
        return pool.replace(policies=unflatten(pool.policies, leaves))

    pools = (
        None if pool is None else filled(role, pool) for role, pool in enumerate(selfplay.pools)
    )
    return selfplay.replace(pools=tuple(pools))


def filled_slots(iteration: int, chunk_iterations: int) -> int:
    """Slots in use after `iteration` iterations: a chunk's own is filled by its first."""
    return -(-iteration // chunk_iterations)


def _named(selfplay: "SelfPlay", policy: Any) -> Arrays:
    """`policy(role, pool)`, leaves [S, ...], of each role that has a pool, by plain names."""
    tree = {
        SIDES[role]: policy(role, pool)
        for role, pool in enumerate(selfplay.pools)
        if pool is not None
    }
    return {
        name.replace("/", "."): np.ascontiguousarray(array) for name, array in flatten(tree).items()
    }


def _at(policy: "SidePolicy", index: int) -> "SidePolicy":
    return jax.tree.map(lambda leaf: leaf[:, index], policy)


def _roster(digests: Iterable[str]) -> Roster:
    digests = list(digests)
    return Roster(len(digests), hashlib.sha256("\n".join(digests).encode()).hexdigest())
