"""One timestep of both drones in MJX. Two free rigid bodies need only some phases of `mjx.step`.

What does not live here: the models (`scene`), the forces and the substeps (`flight`).
"""

from collections.abc import Callable
from typing import Any

import jax
import mujoco

from dronecombat_jax.machine.backend import import_mjx
from dronecombat_jax.sim.scene import Scene

Physics = Callable[[jax.Array, jax.Array, jax.Array], tuple[jax.Array, jax.Array]]

LEVEL = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)  # at the origin, axes along the world's


def build_physics(scene: Scene) -> Physics:
    """Return `advance(qpos [14], qvel [12], force [12]) -> (qpos, qvel)`, one timestep of the lean
    model.

    `force` is MuJoCo's `qfrc_applied`: N in the world frame and N m in the body frame, drone by
    drone. Its small products are float32 whatever `run.matmul_precision` lets the networks do.
    """
    mjx, model, level = load_mjx(scene)

    def advance(qpos: jax.Array, qvel: jax.Array, force: jax.Array) -> tuple[jax.Array, jax.Array]:
        # fwd_position is left out, and `level` holds its results. A free joint's velocity is linear
        # in the world frame and angular in the body's. Where the body's origin is its centre of
        # mass, the equations of motion in these coordinates, m a = f + m g and I w' = t - w x I w,
        # do not contain the pose. So masses, motion axes and inertias of any one pose give them,
        # and at the origin no difference of large positions is rounded.
        data = mjx.fwd_velocity(model, level.replace(qvel=qvel, qfrc_applied=force))
        # No actuators: fwd_actuation is nothing. The forces on bodies in here are constant zeros at
        # a constant pose, which XLA sums while it compiles.
        data = mjx.fwd_acceleration(model, data)
        # No constraints, contacts or sensors: what mjx.step does between the two is nothing, too.
        # The quaternion, which fwd_position would normalise, is normalised by the integrator.
        data = mjx.euler(model, data.replace(qpos=qpos, qacc=data.qacc_smooth))
        return data.qpos, data.qvel

    def precise(qpos: jax.Array, qvel: jax.Array, force: jax.Array) -> tuple[jax.Array, jax.Array]:
        with jax.default_matmul_precision("float32"):
            return advance(qpos, qvel, force)

    return precise


def load_mjx(scene: Scene) -> tuple[Any, Any, Any]:
    """The MJX module, the lean model on the device, and its data with both drones at the origin,
    level and at rest.
    """
    mjx = import_mjx()
    here = jax.local_devices()[0]  # left alone, MJX takes the first of all processes
    data = mujoco.MjData(scene.lean)
    data.qpos[:] = LEVEL * (scene.lean.nq // len(LEVEL))
    mujoco.mj_forward(scene.lean, data)
    return mjx, mjx.put_model(scene.lean, device=here), mjx.put_data(scene.lean, data, device=here)
