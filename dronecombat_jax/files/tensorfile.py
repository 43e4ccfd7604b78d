"""One file of float32 arrays and text in the safetensors format: the same bytes every time, read
without trust.

The library `safetensors` writes and checks the container. Here a file's size, its kind, its names
and its dtypes are limited before that. What does not live here: what the arrays mean (`policies`).
"""

import errno
import hashlib
import json
import os
import re
import stat
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from dronecombat_jax.config.schema import shown
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.files.manifest import state_digest

MAX_HEADER_BYTES = 1_000_000
MAX_FILE_BYTES = 1 << 30
MAX_DIMENSIONS = 8
_PREFIX_BYTES = 8  # the length of the header, little endian
_METADATA = "__metadata__"
_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}")


class PolicyError(UserError):
    """A policy file that cannot be used; exit code 3."""

    def __init__(self, path: Path, reason: str):
        text = str(path)
        super().__init__(f"{text if text.isprintable() else ascii(text)}: {reason}", EXIT_DATA)


def encode(tensors: Mapping[str, np.ndarray], metadata: Mapping[str, str]) -> bytes:
    """The bytes of a file; equal content gives equal bytes.

    Raises ValueError for what is not float32 or has a bad name.
    """
    arrays = {name: np.asarray(tensors[name], order="C") for name in sorted(tensors)}
    for name, array in arrays.items():
        if not _NAME.fullmatch(name) or array.dtype != np.float32:
            raise ValueError(f"{name!r} ({array.dtype}): only float32 arrays with plain names")
    # TRAP: the library writes the metadata in another order in every process. The header is
    # therefore written again, with the metadata in the caller's order. The data begins on a
    # multiple of 8 bytes, as the format asks.
    header, data = _parted(save(arrays))
    text = json.dumps({_METADATA: dict(metadata), **header}, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    if len(text) > MAX_HEADER_BYTES:
        raise ValueError(f"header of {len(text):,} bytes: at most {MAX_HEADER_BYTES:,}")
    return len(text).to_bytes(_PREFIX_BYTES, "little") + text + data


def read(path: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """The arrays and the metadata of a file.

    A link is not followed. Raises PolicyError for anything that is no sound file of float32 arrays.
    """
    try:
        return _checked(_read_bytes(path))
    except OSError as error:
        reason = (
            "it is a link; give the file itself" if error.errno == errno.ELOOP else error.strerror
        )
        raise PolicyError(path, f"cannot be read: {reason}") from None
    except (ValueError, KeyError, RecursionError, SafetensorError) as error:
        text = "".join(letter if letter.isprintable() else "?" for letter in str(error))
        reason = text[:300] or type(error).__name__
        raise PolicyError(path, f"damaged or no safetensors file: {reason}") from None


def digest_of(tensors: Mapping[str, np.ndarray], metadata: Mapping[str, str]) -> str:
    """sha256 in hex over all metadata (but "sha256" itself) and all arrays."""
    text = json.dumps([state_digest(tensors), sorted(metadata.items())], separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _read_bytes(path: Path) -> bytes:
    """All of a plain file that is not too large."""
    # O_NONBLOCK: a pipe must not keep us waiting for its writer
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode):
        os.close(descriptor)
        raise ValueError("not a plain file")
    with os.fdopen(descriptor, "rb") as file:
        if not _PREFIX_BYTES <= status.st_size <= MAX_FILE_BYTES:
            allowed = f"from {_PREFIX_BYTES} to {MAX_FILE_BYTES:,} are read"
            raise ValueError(f"{status.st_size:,} bytes; {allowed}")
        length = int.from_bytes(file.read(_PREFIX_BYTES), "little")
        if length > MAX_HEADER_BYTES:
            raise ValueError(f"its header is longer than {MAX_HEADER_BYTES:,} bytes")
        file.seek(0)
        return file.read(status.st_size)


def _checked(content: bytes) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """What `content` holds, proven by the library; float32 arrays with plain names alone."""
    arrays = load(content)
    header, _ = _parted(content)
    metadata = header.pop(_METADATA, {})
    for name, array in arrays.items():
        if not _NAME.fullmatch(name):
            raise ValueError(f"array name {shown(name)} is not allowed")
        if array.dtype != np.float32:
            raise ValueError(f"array {name}: expected dtype F32, got {header[name]['dtype']}")
        if array.ndim > MAX_DIMENSIONS:
            raise ValueError(f"array {name}: at most {MAX_DIMENSIONS} dimensions are read")
    return {name: array.copy() for name, array in arrays.items()}, metadata


def _parted(content: bytes) -> tuple[dict, bytes]:
    """The header of sound `content` and its data."""
    end = _PREFIX_BYTES + int.from_bytes(content[:_PREFIX_BYTES], "little")
    return json.loads(content[_PREFIX_BYTES:end]), content[end:]
