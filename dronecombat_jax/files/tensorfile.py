"""One file of float32 arrays and text in the safetensors format: the same bytes every time, read
without trust.

    8 bytes    length of the header, little endian
    header     JSON: "__metadata__" (text by name) and, for each array, dtype, shape and data_offsets
    data       the arrays, C order, little endian, end to end

What does not live here: what the arrays mean (`policy`). Format:
https://github.com/huggingface/safetensors. The package `safetensors` would write the metadata in
another order every time, and reads files of any size.
"""

import errno
import json
import math
import os
import re
import stat
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dronecombat_jax.config.schema import one_line, shown
from dronecombat_jax.errors import EXIT_DATA, UserError

MAX_HEADER_BYTES = 1_000_000
MAX_FILE_BYTES = 1 << 30
MAX_DIMENSIONS = 8
_PREFIX_BYTES = 8
_METADATA = "__metadata__"
_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}")


class PolicyError(UserError):
    """A policy file that cannot be used; exit code 3."""

    def __init__(self, path: Path, reason: str):
        text = str(path)
        super().__init__(f"{text if text.isprintable() else ascii(text)}: {reason}", EXIT_DATA)


class Place(NamedTuple):
    """Where an array lies in the data."""

    begin: int
    end: int
    shape: tuple[int, ...]


def encode(tensors: Mapping[str, np.ndarray], metadata: Mapping[str, str]) -> bytes:
    """The bytes of a file; arrays are sorted by name. Raises ValueError for what is not float32 or
    has a bad name.
    """
    header: dict[str, Any] = {_METADATA: dict(metadata)}
    parts, end = [], 0
    for name in sorted(tensors):
        array = np.asarray(tensors[name])
        if not _NAME.fullmatch(name) or array.dtype != np.float32:
            raise ValueError(
                f"{name!r} ({array.dtype}): only float32 arrays with plain names are written"
            )
        parts.append(array.astype("<f4").tobytes())
        begin, end = end, end + 4 * array.size
        header[name] = {"dtype": "F32", "shape": list(array.shape), "data_offsets": [begin, end]}
    text = json.dumps(header, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 8)  # the data begins on a multiple of 8 bytes, as the format asks
    if len(text) > MAX_HEADER_BYTES:
        raise ValueError(f"header of {len(text):,} bytes: at most {MAX_HEADER_BYTES:,}")
    return b"".join([len(text).to_bytes(_PREFIX_BYTES, "little"), text, *parts])


def read(path: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """The arrays and the metadata of a file; everything in it is checked before memory is taken for
    it.

    A link is not followed. Raises PolicyError for anything that is no sound file of float32 arrays.
    """
    try:
        header, data = _read_bytes(path)
        places, metadata = _parse(header, len(data))
    except OSError as error:
        reason = (
            "it is a link; give the file itself" if error.errno == errno.ELOOP else error.strerror
        )
        raise PolicyError(path, f"cannot be read: {reason}") from None
    except RecursionError:
        raise PolicyError(
            path, "damaged or no safetensors file: its header is nested too deeply"
        ) from None
    except ValueError as error:
        reason = "".join(c if c.isprintable() else "?" for c in str(error))
        raise PolicyError(path, f"damaged or no safetensors file: {reason}") from None
    arrays = {
        name: np.frombuffer(data, "<f4", math.prod(place.shape), place.begin)
        .reshape(place.shape)
        .astype(np.float32)
        for name, place in places.items()
    }
    return arrays, metadata


def _read_bytes(path: Path) -> tuple[bytes, bytes]:
    """Header and data of a plain file."""
    # O_NONBLOCK: a pipe must not keep us waiting for its writer
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode):
        os.close(descriptor)
        raise ValueError("not a plain file")
    with os.fdopen(descriptor, "rb") as file:
        if not _PREFIX_BYTES <= status.st_size <= MAX_FILE_BYTES:
            raise ValueError(
                f"{status.st_size:,} bytes; from {_PREFIX_BYTES} to {MAX_FILE_BYTES:,} are read"
            )
        length = int.from_bytes(file.read(_PREFIX_BYTES), "little")
        rest = status.st_size - _PREFIX_BYTES
        if length > min(MAX_HEADER_BYTES, rest):
            limit = (
                f"{rest:,} follow"
                if rest < MAX_HEADER_BYTES
                else f"at most {MAX_HEADER_BYTES:,} are read"
            )
            raise ValueError(f"it announces a header of {length:,} bytes, {limit}")
        header, data = file.read(length), file.read(rest - length)
    if len(header) + len(data) != rest:
        raise ValueError("it was cut while it was read")
    return header, data


def _parse(header: bytes, num_bytes: int) -> tuple[dict[str, Place], dict[str, str]]:
    """Where each array lies and the metadata; ValueError unless the arrays fill the data exactly."""
    table = json.loads(
        header.decode(), object_pairs_hook=_without_duplicates, parse_constant=_refuse_constant
    )
    if not isinstance(table, dict):
        raise ValueError("its header is no JSON object")
    metadata = table.pop(_METADATA, {})
    if not isinstance(metadata, dict) or not all(
        isinstance(value, str) for value in metadata.values()
    ):
        raise ValueError("its metadata is not text by name")
    places = {name: _place(name, entry, num_bytes) for name, entry in table.items()}
    end = 0
    for name, place in sorted(places.items(), key=lambda item: item[1]):
        if place.begin != end:
            raise ValueError(
                f"array {name} begins at byte {place.begin}, not {end}: arrays overlap or leave a gap"
            )
        end = place.end
    if end != num_bytes:
        raise ValueError(f"its arrays take {end:,} bytes and {num_bytes:,} are there")
    return places, metadata


def _place(name: str, entry: Any, num_bytes: int) -> Place:
    if not _NAME.fullmatch(name):
        raise ValueError(f"array name {shown(name)} is not allowed")
    if not isinstance(entry, dict) or set(entry) != {"dtype", "shape", "data_offsets"}:
        raise ValueError(f"array {name} needs dtype, shape and data_offsets")
    if entry["dtype"] != "F32":
        raise ValueError(f"array {name}: expected dtype F32, got {one_line(str(entry['dtype']))}")
    shape, offsets = entry["shape"], entry["data_offsets"]
    if not _whole_numbers(shape, num_bytes) or len(shape) > MAX_DIMENSIONS:
        raise ValueError(
            f"array {name}: shape {shown(shape)} does not fit into {num_bytes:,} bytes"
        )
    if (
        not _whole_numbers(offsets, num_bytes)
        or len(offsets) != 2
        or offsets[1] - offsets[0] != 4 * math.prod(shape)
    ):
        raise ValueError(
            f"array {name}: bytes {shown(offsets)} are not those of float32{shown(shape)}"
        )
    return Place(offsets[0], offsets[1], tuple(shape))


def _whole_numbers(values: Any, highest: int) -> bool:
    """Whether `values` is a list of integers in [0, highest]; True and 1.0 are none."""
    return isinstance(values, list) and all(
        type(value) is int and 0 <= value <= highest for value in values
    )


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) != len(pairs):
        ((twice, _),) = Counter(name for name, _ in pairs).most_common(1)
        raise ValueError(f"{shown(twice)} stands twice in its header")
    return table


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not a JSON number")
