"""Lowered programs, kept between processes: tracing and lowering the training program takes seconds
of every start.

The compiled code itself is kept by JAX (`backend`); to look it up JAX needs the lowered program,
and to get that it traces thousands of operations. Here that text (StableHLO, `jax.export`) is kept
in a file, together with what it was made from: every file that Python had loaded once it was
traced, and the MJCF. As in make, it is good as long as none of them has changed. A process that was
started as a command trusts it; anything else may have replaced a function in memory, which no file
tells, and always traces (`keep`).
"""

import contextlib
import functools
import hashlib
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config, RunConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.files.atomic import write_atomic
from dronecombat_jax.machine import backend, processes

if TYPE_CHECKING:
    import jax

PACKAGES = ("jax", "jaxlib", "mujoco", "mujoco-mjx", "flax", "optax")
VARIABLES = ("JAX_", "XLA_", "MJX_")  # what they are called that tracing may read

# when this process began to keep programs, ns since the epoch; None: it does not
_began: int | None = None


def keep() -> None:
    """Use kept programs in this process.

    For a command's entry point: before anything else could have been replaced.
    """
    global _began
    _began = time.time_ns()


def compiled(
    name: str,
    config: Config,
    build: Callable[[], Callable[[Any], Any]],
    state: Any,
    mesh: "jax.sharding.Mesh | None",
    constants: str = "",
    **options: Any,
) -> Any:
    """`build()`, a program `state -> (state, report)`, compiled for `state`, which is on its
    devices.

    `name`, `config` and `constants` must say all that `build` depends on, but for files. `options` go to
    `jax.jit`. Where the program is kept, `build` is not called.
    """
    from dronecombat_jax.selfplay.mesh import jitted

    program = (
        _kept(name, config, build, state, mesh, constants)
        if _began and processes.count() == 1
        else None
    )
    return jitted(program or build(), state, mesh, **options).lower(state).compile()


def _kept(
    name: str,
    config: Config,
    build: Callable[[], Callable[[Any], Any]],
    state: Any,
    mesh: "jax.sharding.Mesh | None",
    constants: str,
) -> Callable[[Any], Any] | None:
    """The program from its file, else traced and kept; None where `jax.export` cannot do that."""
    from jax import export

    from dronecombat_jax.selfplay.mesh import jitted

    path = backend.cache_dir() / "lowered" / f"{name}-{_key(config, state, mesh, constants)}"
    try:
        _register()
        content = _read(path)
        if content is None:
            content = export.export(jitted(build(), state, mesh))(state).serialize()
            _write(path, content, config)
        return export.deserialize(content).call
    except (ImportError, NotImplementedError, ValueError):
        # no flatbuffers; a custom call that is not for keeping
        return None


def _key(config: Config, state: Any, mesh: "jax.sharding.Mesh | None", constants: str = "") -> str:
    """A digest of what a program depends on besides files.

    A run's name and seed are not in it, nor its length unless something depends on how far its end
    is (`learn.settle`).
    """
    import jax

    run = replace(RunConfig(), seeds_at_once=config.run.seeds_at_once)
    settles = config.learn.settle_share > 0.0 or config.learn.average_share > 0.0
    length = config.train.total_steps if settles else 1
    train = replace(config.train, seed=0, total_steps=length)
    leaves, structure = jax.tree.flatten(state)
    parts = (
        settings.to_toml(replace(config, train=train, run=run)),
        [
            platform.python_version(),
            *(f"{package} {metadata.version(package)}" for package in PACKAGES),
        ],
        sorted(f"{key}={value}" for key, value in os.environ.items() if key.startswith(VARIABLES)),
        [jax.default_backend(), *sorted({device.device_kind for device in jax.devices()})],
        "" if mesh is None else str(mesh.shape),
        str(structure),
        [f"{leaf.dtype}{leaf.shape}" for leaf in leaves],
        sys.path,
        constants,
    )
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:24]


def _read(path: Path) -> bytearray | None:
    """The program in a file; None where there is none, it is damaged, or what it was made from has
    changed.
    """
    try:
        head, _, content = path.read_bytes().partition(b"\n")
        header = json.loads(head)
        if header["sha256"] == hashlib.sha256(content).hexdigest() and all(
            _stamp(file) == stamp for file, *stamp in header["made_from"]
        ):
            return bytearray(content)
    except (OSError, ValueError, KeyError, TypeError):
        pass
    return None


def _write(path: Path, content: bytearray, config: Config) -> None:
    """Keep a program; where that cannot be done, the next start takes longer, and that is all.

    Not one whose code was edited while this process ran: which version it had loaded is not known.
    """
    with contextlib.suppress(OSError, UserError):
        files = sorted(set(_files(config)))
        made_from = [(file, *stamp) for file in files if (stamp := _stamp(file))]
        if _began is None or any(changed > _began for *_, changed in made_from):
            return
        head = json.dumps({"sha256": hashlib.sha256(content).hexdigest(), "made_from": made_from})
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, head.encode() + b"\n" + content)


def _files(config: Config) -> Iterator[str]:
    """Every file of code that this process has loaded, and the MJCF of `config`."""
    from dronecombat_jax.sim.source import files_of

    files = (getattr(module, "__file__", None) for module in list(sys.modules.values()))
    yield from (os.path.abspath(file) for file in files if file)
    yield from map(str, files_of(config.sim))


def _stamp(file: str) -> list[int] | None:
    """Size in bytes and time of the last change in ns; None where there is no such file."""
    try:
        status = os.stat(file)
    except OSError:
        return None
    return [status.st_size, status.st_mtime_ns]


@functools.cache
def _register() -> None:
    """Teach `jax.export` the pytrees that go into a program and come out of it."""
    import optax
    from flax import struct
    from jax import export

    from dronecombat_jax import types

    for node in (*vars(types).values(), optax.EmptyState, optax.ScaleByAdamState):
        if not isinstance(node, type):
            continue
        name = f"{node.__module__}.{node.__qualname__}"
        if issubclass(node, struct.PyTreeNode) and node is not struct.PyTreeNode:
            export.register_pytree_node_serialization(
                node,
                serialized_name=name,
                serialize_auxdata=lambda _: b"",
                deserialize_auxdata=lambda _: (),
            )
        elif issubclass(node, tuple) and hasattr(node, "_fields"):
            export.register_namedtuple_serialization(node, serialized_name=name)
