"""The environments of one seed on several devices: which arrays are split, and along which axis.

What lives here: the axis of the mesh and a hint to the compiler, which places the reductions over
environments by itself (GSPMD). What does not: the mesh and which device holds which part of a state
(`selfplay.mesh`).
"""

from typing import TypeVar

import jax

ENVIRONMENTS = "environments"
Tree = TypeVar("Tree")


def along_environments(tree: Tree, axis: int) -> Tree:
    """`tree`, each leaf split over the devices along `axis`; as it is in a program without a mesh
    of environments.

    The values are the same either way, and nothing is drawn by device: only who computes them
    changes.
    """
    if ENVIRONMENTS not in jax.sharding.get_abstract_mesh().auto_axes:
        return tree

    def split(leaf: jax.Array) -> jax.Array:
        spec = jax.sharding.PartitionSpec(*[None] * (axis % leaf.ndim), ENVIRONMENTS)
        return jax.lax.with_sharding_constraint(leaf, spec)

    return jax.tree.map(split, tree)
