"""Several processes that train one run: how they meet, agree and share. Alone, everything here
costs nothing.

Each process sees all devices and computes its share; only the first one reads and writes the run's
directory. Whatever waits for the others (`anywhere`, `together`, `agreed`, `from_first`, `on_host`)
must be called by every process in the same order. What does not live here: which device computes
what (`selfplay.mesh`).
"""

import hashlib
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np

from dronecombat_jax.errors import EXIT_CONFIG, UserError

Tree = TypeVar("Tree")

COORDINATOR = "JAX_COORDINATOR_ADDRESS"
NUMBERS = ("JAX_NUM_PROCESSES", "JAX_PROCESS_ID")

_index, _count = 0, 1
_joined = False  # able to wait for each other


def join(seconds: float) -> None:
    """Meet the other processes, before JAX computes anything.

    Who they are is read from JAX_COORDINATOR_ADDRESS (host:port of the first process),
    JAX_NUM_PROCESSES and JAX_PROCESS_ID; what is not set there, JAX finds out from SLURM, Open MPI
    and others. Raises UserError 2 where they do not say enough. Where not all have come after
    `seconds` the process ends with exit 2 and one line: JAX itself would abort it, so this cannot
    be an exception.
    """
    global _joined, _index, _count
    import jax

    count, index = (_number(name) for name in NUMBERS)
    address = os.environ.get(COORDINATOR)
    jax.config.update("jax_cpu_collectives_implementation", "gloo")
    # it would catch the signals that we answer
    jax.config.update("jax_enable_preemption_service", False)
    late = threading.Timer(seconds, _give_up, (seconds, address))
    late.daemon = True
    late.start()
    try:
        jax.distributed.initialize(address, count, index, initialization_timeout=int(seconds) + 60)
    except (ValueError, RuntimeError) as error:
        raise UserError(
            f"run.distributed: {_one_line(error)}{_missing(address, count, index)}", EXIT_CONFIG
        ) from None
    finally:
        late.cancel()
    _joined, _index, _count = True, jax.process_index(), jax.process_count()


@contextmanager
def parting() -> Iterator[None]:
    """A block after which the processes wait for each other and separate: then each goes on alone.

    They part as well where the block raises a UserError, which all of them do (`together`).
    """
    try:
        yield
    except UserError:
        _part()
        raise
    _part()


def first() -> bool:
    """Whether this process reads and writes the run's directory."""
    return _index == 0


def count() -> int:
    """How many processes train together."""
    return _count


def anywhere(flag: bool) -> bool:
    """Whether `flag` is set in any process."""
    return any(_gathered(int(flag)))


def agreed(text: str) -> bool:
    """Whether all processes were given the same text."""
    digest = int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big", signed=True)
    return len(set(_gathered(digest))) == 1


@contextmanager
def together() -> Iterator[None]:
    """A block that fails in every process where it fails in one: nobody waits for a process that
    has stopped.

    Raises what the block raised; in the other processes a UserError with the same exit code.
    """
    code = 0
    try:
        yield
    except Exception as error:
        code = error.exit_code if isinstance(error, UserError) else 1
        raise
    finally:
        codes = _gathered(code)
        if not code and any(codes):
            raise UserError(
                f"process {np.flatnonzero(codes)[0]} has stopped and says why", max(codes)
            )


def from_first(tree: Tree) -> Tree:
    """`tree` as the first process has it, bit for bit. The others hand in NumPy leaves of the same
    shapes, whose values do not matter.
    """
    if not _joined:
        return tree
    import jax
    from jax.experimental import multihost_utils

    leaves, structure = jax.tree.flatten(tree)
    leaves = [np.asarray(leaf) for leaf in leaves]
    # as bytes: the sum by which JAX broadcasts would lose the sign of a zero
    packed = np.concatenate([np.frombuffer(leaf.tobytes(), np.uint8) for leaf in leaves])
    received = multihost_utils.broadcast_one_to_all(packed)
    parts = np.split(received, np.cumsum([leaf.nbytes for leaf in leaves])[:-1])
    pairs = zip(parts, leaves, strict=True)
    return jax.tree.unflatten(
        structure, [np.frombuffer(p.tobytes(), x.dtype).reshape(x.shape) for p, x in pairs]
    )


def on_host(tree: Any) -> Any:
    """`tree` with whole NumPy leaves, wherever its parts live."""
    import jax

    if _joined:
        meshes = {leaf.sharding.mesh for leaf in jax.tree.leaves(tree)}
        everywhere = jax.sharding.NamedSharding(meshes.pop(), jax.sharding.PartitionSpec())
        tree = jax.jit(_identity, out_shardings=everywhere)(tree)
    return jax.device_get(tree)


def _part() -> None:
    global _joined
    if _joined:
        import jax

        _joined = False
        jax.distributed.shutdown()


def _identity(tree: Any) -> Any:
    return tree


def _gathered(number: int) -> list[int]:
    """A 32-bit number of each process."""
    if not _joined:
        return [number]
    from jax.experimental import multihost_utils

    return multihost_utils.process_allgather(np.asarray([number], np.int32)).reshape(-1).tolist()


def _number(name: str) -> int | None:
    text = os.environ.get(name)
    if text is None:
        return None
    if not text.isascii() or not text.isdigit():
        raise UserError(f"{name} = {text[:40]!r} must be a whole number", EXIT_CONFIG)
    return int(text)


def _missing(*given: object) -> str:
    names = [
        name for name, value in zip((COORDINATOR, *NUMBERS), given, strict=True) if value is None
    ]
    return f" (not set: {', '.join(names)}, and no SLURM or Open MPI says it)" if names else ""


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]


def _give_up(seconds: float, address: str | None) -> None:
    line = (
        f"error: run.distributed: not all processes met at {address or 'the coordinator that was found'} within "
        f"{seconds:g} s; do all run, and can they reach it? (run.join_seconds)\n"
    )
    os.write(2, line.encode())
    os._exit(EXIT_CONFIG)
