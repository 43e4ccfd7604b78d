"""Checkpoints `checkpoints/<step>/`: written once, proven on every load, never half there.

    checkpoints/12/manifest.json   step, meta, paths, dtypes, shapes and digests (`manifest`)
    checkpoints/12/state/          the arrays, by orbax as numpy in one OCDBT store
    checkpoints/players/           the past players of self-play (`past_players`), which checkpoints share

What does not live here: what the state means, and who may write (`rundir.claim_run` holds the
lock). PRNG keys are not part of a state: seeds are integers and keys are derived from them. The
newest checkpoint is the highest step that verifies; clocks are never asked.
"""

import logging
import os
import re
import secrets
import shutil
from pathlib import Path
from typing import Any

from dronecombat_jax.errors import EXIT_DIVERGED, UserError
from dronecombat_jax.files import store
from dronecombat_jax.files.arrays import (
    Arrays,
    flatten,
    match_template,
    nonfinite,
    unflatten,
)
from dronecombat_jax.files.atomic import (
    cannot_write,
    fsync_directory,
    temporary_path,
)
from dronecombat_jax.files.manifest import (
    RENAMED,
    CheckpointError,
    DamagedCheckpoint,
    Manifest,
    NewerCheckpoint,
    Roster,
    check_files,
    read_manifest,
    state_digest,
)

__all__ = [
    "CheckpointError",
    "latest",
    "load",
    "read_meta",
    "remove",
    "restore",
    "save",
    "steps",
    "verify",
]

_STEP_NAME = re.compile(r"0|[1-9][0-9]{0,17}")
_log = logging.getLogger(__name__)


def save(
    directory: Path,
    step: int,
    state: Any,
    meta: dict[str, Any],
    *,
    players: Roster | None = None,
    allow_nonfinite: bool = False,
) -> Path:
    """Write `state` (a pytree of NumPy arrays) and `meta` (plain JSON) as `directory/<step>`.

    `players`: the past players that belong to it and are on the disk already.

    When this returns, the checkpoint has been read back, has verified and is on the disk. A step
    that is there already with the same arrays is left alone (`meta` is not compared).
    Raises UserError 73 where the disk refuses, UserError 4 on NaN or infinity, CheckpointError
    where the step holds other arrays. On any error the old checkpoints stand, nothing is left over.
    """
    arrays = flatten(state)
    if not allow_nonfinite and (wrong := nonfinite(arrays)):
        raise UserError(f"checkpoint {step} not written: NaN or infinity in {wrong}", EXIT_DIVERGED)
    digest = state_digest(arrays)
    final = _step_path(directory, step)
    if os.path.lexists(final) and _holds(final, step, arrays):
        return final
    temporary = temporary_path(final)
    try:
        # not its parents: a run that was moved away must not come back empty
        directory.mkdir(exist_ok=True)
        temporary.mkdir()
        store.write(temporary, final, step, arrays, digest, meta, players)
        os.rename(temporary, final)
        fsync_directory(directory)
    except OSError as error:
        raise cannot_write(final, error, store.bytes_of(arrays)) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return final


def steps(directory: Path) -> list[int]:
    """Steps that have an entry in `directory`, rising; whether they verify is not asked."""
    if not directory.is_dir():
        return []
    return sorted(
        int(entry.name) for entry in directory.iterdir() if _STEP_NAME.fullmatch(entry.name)
    )


def latest(directory: Path, *, set_aside: bool = True, below: int | None = None) -> Manifest | None:
    """The manifest of the highest step that verifies (of those under `below`), or None. Needs no
    JAX.

    Damaged ones above it are warned of and renamed to `damaged-<step>-...`, never deleted
    (`set_aside=False`, for readers that do not hold the run's lock: only warned of).
    Raises NewerCheckpoint where a later version of this package has written one.
    """
    for step in reversed(steps(directory)):
        if below is not None and step >= below:
            continue
        try:
            manifest = verify(directory, step)
        except NewerCheckpoint:
            raise
        except DamagedCheckpoint as error:
            _log.warning("checkpoint %d skipped: %s", step, error)
            if set_aside:
                _set_aside(_step_path(directory, step))
        except CheckpointError as error:
            _log.warning("checkpoint %d skipped: %s", step, error)
        else:
            return manifest
    return None


def verify(directory: Path, step: int) -> Manifest:
    """Check every byte of a checkpoint against its manifest; raises CheckpointError. Needs no JAX."""
    path = _step_path(directory, step)
    if not os.path.lexists(path):
        raise CheckpointError(
            f"no checkpoint {step} in {directory} (there: {_shown(steps(directory))})"
        )
    manifest = read_manifest(path)
    if manifest.step != step:
        raise DamagedCheckpoint(f"{path} is a copy of checkpoint {manifest.step}")
    check_files(path, manifest)
    return manifest


def read_meta(directory: Path, step: int) -> dict[str, Any]:
    """The `meta` that was saved with a checkpoint, after verifying all of it."""
    return verify(directory, step).meta


def restore(
    directory: Path,
    saved: int | Manifest,
    template: Any,
    *,
    hint: str = "",
    allow_nonfinite: bool = False,
) -> Any:
    """The saved state in the structure of `template`, as NumPy arrays, bit for bit.

    `saved`: its step, or its manifest from `latest` or `verify`, whose files are then not hashed
    again. `template` is a pytree of arrays or `jax.ShapeDtypeStruct`; nothing is cast or broadcast.
    Raises CheckpointError for a damaged checkpoint, for NaN or infinity, and where arrays do not
    fit: it names the first five and ends with `hint` (which setting to change).
    """
    manifest = saved if isinstance(saved, Manifest) else verify(directory, saved)
    path = _step_path(directory, manifest.step)
    leaves = tuple(
        leaf._replace(path=RENAMED.get(leaf.path, leaf.path)) for leaf in manifest.leaves
    )
    expected = match_template(template, leaves, str(path), hint)
    arrays = _renamed(store.read(path, manifest))
    if not allow_nonfinite and (wrong := nonfinite(arrays)):
        raise CheckpointError(f"{path} refused: NaN or infinity in {wrong}")
    return unflatten(template, [arrays[leaf.path] for leaf in expected])


def load(directory: Path, saved: int | Manifest) -> tuple[Arrays, Manifest]:
    """The saved arrays by path, without a template: for migration, inspection and golden files;
    `saved` as above.
    """
    manifest = saved if isinstance(saved, Manifest) else verify(directory, saved)
    return _renamed(store.read(_step_path(directory, manifest.step), manifest)), manifest


def remove(directory: Path, step: int) -> None:
    """Delete a checkpoint; half deleted it has a temporary name. Raises UserError 73."""
    path = _step_path(directory, step)
    doomed = temporary_path(path)
    try:
        os.rename(path, doomed)
        shutil.rmtree(doomed)
    except OSError as error:
        raise cannot_write(path, error) from error


def _renamed(arrays: Arrays) -> Arrays:
    """`arrays` of a checkpoint of any version, by the paths of today."""
    return {RENAMED.get(path, path): array for path, array in arrays.items()}


def _holds(final: Path, step: int, arrays: Arrays) -> bool:
    """Whether `final` holds `arrays`, also by older names; a damaged one is moved out of the way."""
    try:
        manifest = verify(final.parent, step)
    except DamagedCheckpoint as error:
        _log.warning("checkpoint %d written anew: %s", step, error)
        _set_aside(final)
        return False
    older = {now: then for then, now in RENAMED.items()}
    renamed = {older.get(path, path): array for path, array in arrays.items()}
    if manifest.digest not in (state_digest(arrays), state_digest(renamed)):
        raise CheckpointError(
            f"{final} is there already with other arrays; a checkpoint is never overwritten"
        )
    return True


def _set_aside(path: Path) -> None:
    aside = path.with_name(f"damaged-{path.name}-{secrets.token_hex(4)}")
    try:
        os.rename(path, aside)
        fsync_directory(path.parent)
    except OSError as error:
        raise cannot_write(aside, error) from error
    _log.warning("%s renamed to %s", path, aside.name)


def _step_path(directory: Path, step: int) -> Path:
    if isinstance(step, bool) or not isinstance(step, int) or not 0 <= step < 10**18:
        raise ValueError(f"step must be an int in [0, 1e18): {step!r}")
    return Path(directory) / str(step)


def _shown(numbers: list[int]) -> str:
    return ", ".join(map(str, numbers[-10:])) or "none"
