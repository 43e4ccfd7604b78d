"""What a checkpoint claims to hold, and the proof: `manifest.json` beside the arrays. No JAX here.

Two digests guard a checkpoint. `files` lists size and sha256 of every file the array library wrote,
so that damaged bytes never reach its parsers; `digest` covers the arrays themselves, so that what
comes out of the library is what went in. The manifest carries a sha256 of its own content.
"""

import errno
import hashlib
import json
import os
import stat
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import numpy as np

from dronecombat_jax.errors import EXIT_DATA, UserError

SCHEMA = 3  # 1: self-play's pool was part of every state; up to 2: old names of RENAMED
RENAMED = {"env/out": "env/down"}  # paths of leaves in older checkpoints, and what they are now
MANIFEST_NAME = "manifest.json"
MAX_MANIFEST_BYTES = 4 << 20
_READ_BYTES = 1 << 20
# What the system says when the file is not the plain file that was written, rather than unreadable.
_WRONG_KIND = (errno.ENOENT, errno.ENOTDIR, errno.ELOOP, errno.EISDIR, errno.ENXIO)


class CheckpointError(UserError):
    """A checkpoint that cannot be used; exit code 3."""

    def __init__(self, message: str):
        super().__init__(message, EXIT_DATA)


class DamagedCheckpoint(CheckpointError):
    """What is on the disk is not what was written."""


class NewerCheckpoint(CheckpointError):
    """Written by a later version of this package."""


class Leaf(NamedTuple):
    """One array of the state: its path in the tree, NumPy's name of its dtype, its shape."""

    path: str
    dtype: str
    shape: tuple[int, ...]

    def __str__(self) -> str:
        return f"{self.dtype}[{','.join(map(str, self.shape))}]"


class StoredFile(NamedTuple):
    """One file below the checkpoint: POSIX path relative to it, bytes, sha256 in hex."""

    path: str
    size: int
    sha256: str


class Roster(NamedTuple):
    """The past players that a checkpoint needs (`past_players`): slots 0, 1, ... and a digest over
    all.
    """

    slots: int  # how many
    digest: str


class Manifest(NamedTuple):
    """Everything about a checkpoint but its arrays."""

    step: int
    digest: str
    leaves: tuple[Leaf, ...]
    files: tuple[StoredFile, ...]
    meta: dict[str, Any]
    players: Roster | None = None  # None: its state is whole


def state_digest(arrays: Mapping[str, np.ndarray]) -> str:
    """sha256 in hex over path, dtype, shape and bytes of every array, in the order of their paths."""
    total = hashlib.sha256()
    for path in sorted(arrays):
        array = arrays[path]
        header = json.dumps([path, array.dtype.name, list(array.shape)], separators=(",", ":"))
        total.update(header.encode() + b"\n")
        # uint8: hashlib does not take bfloat16; the length follows from the header
        total.update(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
    return total.hexdigest()


def encode_manifest(manifest: Manifest) -> bytes:
    """The text of `manifest.json`. Raises TypeError or ValueError where `meta` is no plain JSON."""
    body = {"schema": SCHEMA, **manifest._asdict()}
    data = json.dumps({"sha256": _body_digest(body), **body}, indent=1, allow_nan=False).encode()
    if len(data) > MAX_MANIFEST_BYTES:
        raise ValueError(f"manifest of {len(data):,} bytes: at most {MAX_MANIFEST_BYTES:,}")
    return data


def read_manifest(checkpoint: Path) -> Manifest:
    """Read and check `manifest.json`; raises DamagedCheckpoint or NewerCheckpoint."""
    path = checkpoint / MANIFEST_NAME
    if checkpoint.is_symlink():
        raise DamagedCheckpoint(f"{checkpoint} is a link, not a directory")
    data = _read_whole(path)
    try:
        body = json.loads(data, parse_constant=_refuse_constant)
        claimed = body.pop("sha256")
        if claimed != _body_digest(body):
            raise ValueError("its sha256 does not match its content")
        if body["schema"] > SCHEMA:
            message = f"{checkpoint} has format {body['schema']}, this version reads up to {SCHEMA}: upgrade dronecombat-jax"
            raise NewerCheckpoint(message)
        return Manifest(
            step=int(body["step"]),
            digest=str(body["digest"]),
            leaves=tuple(Leaf(name, dtype, tuple(shape)) for name, dtype, shape in body["leaves"]),
            files=tuple(
                StoredFile(_inside(name), size, digest) for name, size, digest in body["files"]
            ),
            meta=dict(body["meta"]),
            players=None
            if body.get("players") is None
            else Roster(int(body["players"][0]), str(body["players"][1])),
        )
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise DamagedCheckpoint(f"{path} is damaged: {type(error).__name__}: {error}") from error


def list_files(checkpoint: Path, folder: str) -> tuple[StoredFile, ...]:
    """Size and sha256 of every file below `checkpoint/folder`, sorted by path."""
    paths = sorted(path for path in (checkpoint / folder).rglob("*") if not path.is_dir())
    return tuple(
        StoredFile(path.relative_to(checkpoint).as_posix(), *_measure(path)) for path in paths
    )


def check_files(checkpoint: Path, manifest: Manifest) -> None:
    """Compare every listed file with the disk; raises DamagedCheckpoint at the first difference."""
    for stored in manifest.files:
        path = checkpoint / stored.path
        size, digest = _measure(path)
        if size != stored.size:
            raise DamagedCheckpoint(
                f"{path} is damaged: {size:,} bytes, {stored.size:,} were written"
            )
        if digest != stored.sha256:
            raise DamagedCheckpoint(f"{path} is damaged: its sha256 does not match")


def _body_digest(body: Mapping[str, Any]) -> str:
    text = json.dumps(body, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not a JSON number")


def _inside(name: str) -> str:
    """The relative path itself, unless it leads out of the checkpoint."""
    parts = PurePosixPath(name).parts
    if not parts or parts[0] == "/" or ".." in parts:
        raise ValueError(f"file {name!r} lies outside the checkpoint")
    return name


def _open_plain(path: Path) -> tuple[int, int]:
    """Descriptor and size of a plain file; never follows a link, never waits on a pipe."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError as error:
        if error.errno in _WRONG_KIND:
            raise DamagedCheckpoint(f"{path} is missing or not a plain file") from error
        raise CheckpointError(f"cannot read {path}: {error.strerror}") from error
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode):
        os.close(descriptor)
        raise DamagedCheckpoint(f"{path} is not a plain file")
    return descriptor, status.st_size


def _measure(path: Path) -> tuple[int, str]:
    """Bytes and sha256 of a plain file."""
    descriptor, size = _open_plain(path)
    digest = hashlib.sha256()
    try:
        while block := os.read(descriptor, _READ_BYTES):
            digest.update(block)
    except OSError as error:
        raise CheckpointError(f"cannot read {path}: {error.strerror}") from error
    finally:
        os.close(descriptor)
    return size, digest.hexdigest()


def _read_whole(path: Path) -> bytes:
    descriptor, size = _open_plain(path)
    with os.fdopen(descriptor, "rb") as file:
        if size > MAX_MANIFEST_BYTES:
            raise DamagedCheckpoint(f"{path} is damaged: {size:,} bytes")
        try:
            return file.read(MAX_MANIFEST_BYTES)
        except OSError as error:
            raise CheckpointError(f"cannot read {path}: {error.strerror}") from error
