"""The devices of a run as a mesh, seeds x environments, and which part of a state each of them
holds.

A device trains its share of the seeds, and nothing passes between seeds. Where a seed has several
devices, each flies its share of the environments, and the compiler adds up what learning needs of
all (`learn.sharding`). A state on the host is whole whatever the mesh: it goes on with any other
number of devices.
"""

from collections.abc import Callable
from typing import Any

import jax

from dronecombat_jax.learn.sharding import ENVIRONMENTS
from dronecombat_jax.types import TrainState

SEEDS = "seeds"


def device_mesh(seeds: int, environments: int = 1) -> jax.sharding.Mesh:
    """A mesh of the first `seeds * environments` devices of all processes; those of one seed are
    neighbours.

    It has an axis of environments only where a seed has several devices.
    """
    devices = jax.devices()[: seeds * environments]
    shape, names = (
        ((seeds, environments), (SEEDS, ENVIRONMENTS)) if environments > 1 else ((seeds,), (SEEDS,))
    )
    return jax.make_mesh(shape, names, (jax.sharding.AxisType.Auto,) * len(shape), devices=devices)


def over_seeds(
    program: Callable[[TrainState], Any], mesh: jax.sharding.Mesh
) -> Callable[[TrainState], Any]:
    """`program` of some seeds, leaves [S', ...], as one of all seeds [S, ...]: each row of the mesh
    takes its share.
    """
    seeds = jax.sharding.PartitionSpec(SEEDS)
    return jax.shard_map(
        program,
        mesh=mesh,
        in_specs=seeds,
        out_specs=seeds,
        axis_names=frozenset({SEEDS}),
        check_vma=False,
    )


def layout(mesh: jax.sharding.Mesh, state: TrainState) -> TrainState:
    """Where each leaf of a state lives: fights by seed and environment, all else by seed, the same
    for its devices.
    """
    here = lambda *axes: jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec(*axes))
    where = jax.tree.map(lambda _: here(SEEDS), state)
    split = lambda fights: jax.tree.map(lambda _: here(*mesh.axis_names), fights)
    return where.replace(env=split(state.env), flown=split(state.flown))


def place(state: TrainState, mesh: jax.sharding.Mesh | None) -> TrainState:
    """A state from the host, NumPy leaves [S, ...], on the devices; in every process the same."""
    if mesh is None:
        return jax.device_put(state)
    put = lambda leaf, where: jax.make_array_from_callback(
        leaf.shape, where, lambda index: leaf[index]
    )
    return jax.tree.map(put, state, layout(mesh, state))


def jitted(
    advance: Callable[[TrainState], Any],
    state: TrainState,
    mesh: jax.sharding.Mesh | None,
    **options: Any,
):
    """`advance(state) -> (state, report)` jitted: the state stays where it is, the report comes to
    every device.

    `options` go to `jax.jit`.
    """
    if mesh is None:
        return jax.jit(advance, **options)
    everywhere = jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec())
    return jax.jit(advance, out_shardings=(layout(mesh, state), everywhere), **options)
