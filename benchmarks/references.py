"""What others reach on the same models: C MuJoCo's own threaded rollout. Plain MJX is in
`stepping`, beside ours.
"""

import os
from typing import Any

from benchmarks.size import Size
from benchmarks.worker import Part, Program


def mujoco_rollout(size: Size) -> Part:
    """`mujoco.rollout` with a thread on each core: the lean model that MJX steps, and the full one
    with its actuators.

    Environment steps (two physics steps) per second, in float64 as C MuJoCo computes; states are
    written for every step.
    """
    import mujoco
    import numpy as np
    from mujoco.rollout import Rollout

    from dronecombat_jax.sim.scene import load_scene

    sim = size.config().sim
    scene, threads = load_scene(sim), len(os.sched_getaffinity(0))
    steps = size.flown_steps * sim.substeps
    pool = Rollout(nthread=threads)
    hover = np.zeros(scene.full.nu)
    hover[scene.controls[:, 0]] = scene.weight
    lift = np.zeros(scene.lean.nv)
    lift[[2, 8]] = scene.weight
    spec = mujoco.mjtState

    def program(name: str, model: Any, control: np.ndarray, kind: Any) -> Program:
        data = [mujoco.MjData(model) for _ in range(threads)]
        data[0].qpos[[2, 9]] = 1.0
        start = np.empty(mujoco.mj_stateSize(model, spec.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(model, data[0], start, spec.mjSTATE_FULLPHYSICS)
        starts = np.tile(start, (size.num_envs, 1))
        controls = np.tile(control, (size.num_envs, steps, 1))
        state = np.empty((size.num_envs, steps, len(start)))

        def call() -> None:
            pool.rollout(model, data, starts, controls, control_spec=int(kind), state=state)

        return Program(name, "steps/s", size.num_envs * size.flown_steps, call)

    return Part(
        [
            program("lean", scene.lean, lift, spec.mjSTATE_QFRC_APPLIED),
            program("full", scene.full, hover, spec.mjSTATE_CTRL),
        ],
        facts={"threads": threads},
    )
