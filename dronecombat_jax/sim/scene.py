"""The models of a scene, and names to indices, once, at load.

Two models come from one file: the full one for viewers, renderers and C MuJoCo, and a lean one
(two rigid bodies, nothing else) that MJX steps. What is read out of the file: `source`; forces and
substeps: `flight`, MJX: `physics`.
"""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.sim import mjcf, own_drone
from dronecombat_jax.sim.flown import ALIGNED, DRONES, Flown, rigid_bodies
from dronecombat_jax.sim.rotors import Rotors
from dronecombat_jax.sim.source import (
    CAMERAS,
    TARGET,
    Written,
    apply_game,
    find_mjcf_dir,
    naming_the_setting,
    read_drones,
    read_written,
    require_names,
)
from dronecombat_jax.sim.wrench import control_columns, refuse_other_wrench, set_controls
from dronecombat_jax.sim.written import read_flown


@dataclass(frozen=True, eq=False)
class Scene:
    """Both models of one MJCF and the indices into them; drones are in the order of `DRONES`.

    `qpos`, `qvel` hold in both models; body, mocap, control and camera indices are those of `full`.
    """

    path: Path
    full: mujoco.MjModel
    lean: mujoco.MjModel
    flown: Flown  # every number that a step of rigid bodies depends on
    rotors: Rotors | None  # and one with rotors or drag; None: nothing says them
    qpos: tuple[slice, slice]  # 7 each: xyz in m (world), quaternion wxyz
    qvel: tuple[slice, slice]  # 6 each: m/s in the world frame, rad/s in the body frame
    bodies: tuple[int, int]
    target_body: int
    target_mocap: int  # row of `mocap_pos`
    controls: np.ndarray  # [A, 4] columns of ctrl: thrust in N, moments in N m
    arena_camera: int
    chase_cameras: tuple[int, int]
    mass: np.ndarray  # [A] kg
    inertia: np.ndarray  # [A, 3] kg m^2, principal moments
    axes: np.ndarray | None  # [A, 3, 3], columns: principal axes; None: they are the bodies' own
    weight: np.ndarray  # [A] N


def load_scene(sim: SimConfig, path: Path | None = None) -> Scene:
    """Compile the MJCF at `path` (default: that of `sim`) for the body and timestep of `sim`.

    Raises UserError, one line that names the file, for what is missing, wrong or cannot be flown.
    """
    written = read_written(sim, path)
    flown = written.flown
    full = written.model if written.whole else _arena_with(sim, written)
    with naming_the_setting(sim):
        set_controls(sim, full, flown)
        refuse_other_wrench(written.path, full)
    mass = np.array([body.mass for body in flown.bodies])
    aligned = all(body.axes == ALIGNED for body in flown.bodies)
    body_id = lambda name: full.body(name).id
    cameras = [full.camera(name).id for name in CAMERAS]
    return Scene(
        path=written.path,
        full=full,
        lean=rigid_bodies(flown, sim.timestep, for_mjx=True),
        flown=flown,
        rotors=written.rotors,
        qpos=(slice(0, 7), slice(7, 14)),
        qvel=(slice(0, 6), slice(6, 12)),
        bodies=(body_id(DRONES[0]), body_id(DRONES[1])),
        target_body=body_id(TARGET),
        target_mocap=int(full.body_mocapid[body_id(TARGET)]),
        controls=control_columns(full),
        arena_camera=cameras[0],
        chase_cameras=(cameras[1], cameras[2]),
        mass=mass,
        inertia=np.array([body.inertia for body in flown.bodies]),
        axes=None if aligned else np.array([body.rotation for body in flown.bodies]),
        weight=mass * flown.gravity,
    )


def _arena_with(sim: SimConfig, written: Written) -> mujoco.MjModel:
    """The package's arena with the file's drone in both places."""
    arena = find_mjcf_dir() / "combat.xml"
    spec = mjcf.parse(arena)
    require_names(arena, spec)
    own_drone.hang(spec, written.path, written.own_name, written.drones[0], written.flown)
    apply_game(sim, spec)
    model = mjcf.compiled(written.path, spec)
    read_flown(arena, model, read_drones(model))  # its looks add nothing to the flight
    return model
