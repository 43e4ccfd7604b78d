"""A pytree of arrays as a flat table of NumPy arrays by path, and the checks made on it.

A path names a leaf as a person would: `defender/params/policy/Dense_0/kernel`.
"""

from typing import Any

import numpy as np

from dronecombat_jax.files.manifest import CheckpointError, Leaf

Arrays = dict[str, np.ndarray]

_MAX_NAMED = 5
_KINDS = "biufc"  # bool, integers, floats, complex: what has one meaning on every machine


def flatten(tree: Any) -> Arrays:
    """Every leaf as a NumPy array, by path.

    Raises TypeError for a leaf that is no plain array (Python numbers lose their dtype; typed PRNG
    keys, objects and text do not belong in a state), ValueError for a tree without numbers.
    """
    arrays = {path: _plain(path, leaf) for path, leaf in paths(tree)}
    if not any(array.size for array in arrays.values()):
        raise ValueError("a state without any number cannot be saved")
    return arrays


def unflatten(template: Any, leaves: list[np.ndarray]) -> Any:
    """`leaves`, in the order of `match_template`, in the structure of `template`."""
    import jax

    return jax.tree_util.tree_unflatten(jax.tree_util.tree_structure(template), leaves)


def leaves_of(arrays: Arrays) -> tuple[Leaf, ...]:
    """Path, dtype and shape of each array, sorted by path."""
    return tuple(Leaf(path, arrays[path].dtype.name, arrays[path].shape) for path in sorted(arrays))


def match_template(template: Any, saved: tuple[Leaf, ...], name: str, hint: str) -> list[Leaf]:
    """The leaves of `template` in its order, if `saved` holds exactly them; else CheckpointError."""
    expected = [
        Leaf(path, np.dtype(leaf.dtype).name, tuple(leaf.shape)) for path, leaf in paths(template)
    ]
    wanted, given = {leaf.path: leaf for leaf in expected}, {leaf.path: leaf for leaf in saved}
    names = [leaf.path for leaf in expected] + [
        leaf.path for leaf in saved if leaf.path not in wanted
    ]
    wrong = [path for path in names if wanted.get(path) != given.get(path)]
    if not wrong:
        return expected
    named = "; ".join(
        f"{path}: expected {wanted.get(path, 'nothing')}, got {given.get(path, 'nothing')}"
        for path in wrong[:_MAX_NAMED]
    )
    more = f"; and {len(wrong) - _MAX_NAMED} more" if len(wrong) > _MAX_NAMED else ""
    raise CheckpointError(f"{name} does not fit: {named}{more}{'. ' + hint if hint else ''}")


def nonfinite(arrays: Arrays) -> str:
    """The first arrays that hold NaN or infinity and how many numbers of each; empty where none
    does.
    """
    wrong = [
        f"{path} ({count:,} of {array.size:,})"
        for path, array in arrays.items()
        if (count := _count(array))
    ]
    more = f" and {len(wrong) - _MAX_NAMED} more" if len(wrong) > _MAX_NAMED else ""
    return ", ".join(wrong[:_MAX_NAMED]) + more


def paths(tree: Any) -> list[tuple[str, Any]]:
    """Every leaf with its path, in JAX's order. Raises ValueError where two paths are equal."""
    import jax

    pairs = [
        (jax.tree_util.keystr(path, simple=True, separator="/"), leaf)
        for path, leaf in jax.tree_util.tree_flatten_with_path(tree)[0]
    ]
    names = [path for path, _ in pairs]
    if "" in names or len(set(names)) != len(names):
        raise ValueError(
            "every leaf of a state needs a path of its own (a bare array, or two equal paths)"
        )
    return pairs


def _plain(path: str, leaf: Any) -> np.ndarray:
    if isinstance(leaf, bool | int | float | complex | str | bytes) and not isinstance(
        leaf, np.generic
    ):
        raise TypeError(
            f"{path} is a Python {type(leaf).__name__}: give it a dtype, or put it into meta"
        )
    array = np.asarray(leaf)
    # ml_dtypes (bfloat16, float8) report kind V but are registered with NumPy (2); records are not
    # (0)
    custom = array.dtype.kind == "V" and array.dtype.isbuiltin == 2
    if not (array.dtype.kind in _KINDS or custom) or not array.dtype.isnative:
        raise TypeError(f"{path} has dtype {array.dtype}: only plain native numbers can be saved")
    return array


def _count(array: np.ndarray) -> int:
    if array.dtype.kind in "biu":
        return 0
    return array.size - int(np.count_nonzero(np.isfinite(array)))
