"""Programs compiled ahead of time, for one device or spread over several; their leaves lead with
[S, ...].
"""

import time
from collections.abc import Callable
from typing import Any

import jax

from benchmarks import patience
from benchmarks.worker import Part, Program

Mesh = jax.sharding.Mesh


def spread(single: Callable[..., Any], mesh: Mesh | None) -> Callable[..., Any]:
    """`one` for each of arguments [S, ...], in turn on one device; a `mesh` shares S out along its
    first axis.
    """
    every = lambda *batch: jax.lax.map(lambda each: single(*each), batch)
    if mesh is None:
        return every
    part = jax.sharding.PartitionSpec(mesh.axis_names[0])
    return jax.shard_map(every, mesh=mesh, in_specs=part, out_specs=part, check_vma=False)


def place(tree: Any, mesh: Mesh | None) -> Any:
    """Leaves [S, ...] where `spread` wants them."""
    where = (
        jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec(mesh.axis_names[0]))
        if mesh
        else None
    )
    return jax.device_put(jax.device_get(tree), where)


def add(part: Part, name: str, work: float, function: Callable[..., Any], *arguments: Any) -> None:
    """Compile `function` for `arguments`, and add to `part` a program that calls it and waits;
    unit: steps/s.
    """
    program = compile_timed(part, name, function, *arguments)

    def call() -> None:
        jax.block_until_ready(program(*arguments))

    part.programs.append(Program(name, "steps/s", work, call))


def compile_timed(
    part: Part,
    name: str,
    function: Callable[..., Any],
    *arguments: Any,
    donate: tuple[int, ...] = (),
) -> Callable[..., Any]:
    """Trace and compile `function` for `arguments`; the seconds go into `part`."""
    start = time.perf_counter()
    program = jax.jit(function, donate_argnums=donate).lower(*arguments).compile()
    part.compile_seconds[name] = time.perf_counter() - start
    patience.alive()
    return program
