"""Policy files with what a test wants in them."""

from pathlib import Path

from policies import make_info, make_policy

from dronecombat_jax.files import tensorfile
from dronecombat_jax.policies.file import (
    digest_of,
    tensors_of,
)
from dronecombat_jax.policies.info import metadata_of


def write(path: Path, tensors: dict | None = None, metadata: dict | None = None) -> Path:
    """A sound container with a right digest, some of it replaced; None leaves a thing out."""
    arrays = {**tensors_of(make_policy()), **(tensors or {})}
    about = {**metadata_of(make_info()), **(metadata or {})}
    arrays = {name: array for name, array in arrays.items() if array is not None}
    about = {name: text for name, text in about.items() if text is not None}
    path.write_bytes(tensorfile.encode(arrays, {"sha256": digest_of(arrays, about), **about}))
    return path
