"""Cells of a tournament on disk: shards that are only ever added, each cell found again by the
content of its players.

    cells/<sha256>.npz    context (JSON) and n cells: defender, attacker [n, 32], cause [n, E], steps [n, E]

A shard is named after the hash of its bytes and is there whole or not at all. What does not live
here: the result made of the cells (`result_file`). Needs no JAX.
"""

import hashlib
import io
import json
import logging
import os
import secrets
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.files.atomic import cannot_write, write_atomic

_log = logging.getLogger(__name__)


class Pair(NamedTuple):
    """All fights between two players, by their identities."""

    defender: str
    attacker: str
    cause: NDArray[np.int8]  # [E]
    steps: NDArray[np.int32]  # [E]


def write_shard(folder: Path, context: dict[str, Any], cells: Sequence[Pair]) -> None:
    """Add `cells` flown under `context` (plain JSON) to `folder`; the same cells again change
    nothing. UserError 73.
    """
    if not cells:
        return
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        context=np.frombuffer(_spelt(context), np.uint8),
        defender=np.stack([_digest(cell.defender) for cell in cells]),
        attacker=np.stack([_digest(cell.attacker) for cell in cells]),
        cause=np.stack([cell.cause for cell in cells]).astype(np.int8),
        steps=np.stack([cell.steps for cell in cells]).astype(np.int32),
    )
    data = buffer.getvalue()
    write_atomic(folder / f"{hashlib.sha256(data).hexdigest()}.npz", data)


def read_cells(
    folder: Path,
    context: dict[str, Any],
    defenders: Sequence[str],
    attackers: Sequence[str],
    episodes: int,
) -> tuple[NDArray[np.int8], NDArray[np.int32]]:
    """Causes and steps [D, A, E] of the cells in `folder` that were flown under `context`; 0 where
    there is none.

    A damaged shard is warned of and set aside, and its cells count as not flown.
    """
    cause = np.zeros((len(defenders), len(attackers), episodes), np.int8)
    steps = np.zeros(cause.shape, np.int32)
    index = [
        {_digest(entrant).tobytes(): i for i, entrant in enumerate(side)}
        for side in (defenders, attackers)
    ]
    wanted = _spelt(context)
    for path in sorted(folder.glob("*.npz")):
        shard = _read(path)
        if shard is None or shard["context"].tobytes() != wanted:
            continue
        rows, columns = (
            np.asarray([known.get(digest.tobytes(), -1) for digest in shard[side]], int)
            for known, side in zip(index, ("defender", "attacker"), strict=True)
        )
        here = (rows >= 0) & (columns >= 0)
        cause[rows[here], columns[here]] = shard["cause"][here]
        steps[rows[here], columns[here]] = shard["steps"][here]
    return cause, steps


def _read(path: Path) -> dict[str, NDArray] | None:
    """A shard's arrays; None where its bytes are not those that were written."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror}", EXIT_DATA) from None
    if hashlib.sha256(data).hexdigest() != path.stem:
        _set_aside(path)
        return None
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def _set_aside(path: Path) -> None:
    aside = path.with_name(f"damaged-{secrets.token_hex(4)}-{path.stem[:16]}")
    try:
        os.rename(path, aside)
    except OSError as error:
        raise cannot_write(aside, error) from error
    _log.warning("%s is damaged: renamed to %s, its cells are flown again", path, aside.name)


def _digest(identity: str) -> NDArray[np.uint8]:
    return np.frombuffer(hashlib.sha256(identity.encode()).digest(), np.uint8)


def _spelt(context: dict[str, Any]) -> bytes:
    return json.dumps(context, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
