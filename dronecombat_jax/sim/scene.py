"""The models of a scene, and names to indices, once, at load.

Two models come from one file: the full one for viewers, renderers and C MuJoCo, and a lean one
(rigid bodies, nothing else) that MJX steps. What is read out of the file: `source`; forces and
substeps: `flight`, MJX: `physics`.
"""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.config.sides import DUEL, Sides, drone_names, spelt, team
from dronecombat_jax.errors import UserError
from dronecombat_jax.sim import mjcf, own_drone
from dronecombat_jax.sim.flown import ALIGNED, Flown, rigid_bodies, set_inertial
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
from dronecombat_jax.sim.teams import parse_arena
from dronecombat_jax.sim.wrench import control_columns, refuse_other_wrench, set_controls
from dronecombat_jax.sim.written import read_flown


@dataclass(frozen=True, eq=False)
class Scene:
    """Both models of one MJCF and the indices into them; drones are in the order of `sides`.

    `qpos`, `qvel` hold in both models; body, mocap, control and camera indices are those of `full`.
    """

    path: Path
    full: mujoco.MjModel
    lean: mujoco.MjModel
    flown: Flown  # every number that a step of rigid bodies depends on
    rotors: Rotors | None  # and one with rotors or drag; None: nothing says them
    sides: Sides  # of each drone
    qpos: tuple[slice, ...]  # 7 each: xyz in m (world), quaternion wxyz
    qvel: tuple[slice, ...]  # 6 each: m/s in the world frame, rad/s in the body frame
    bodies: tuple[int, ...]
    target_body: int
    target_mocap: int  # row of `mocap_pos`
    controls: np.ndarray  # [A, 4] columns of ctrl: thrust in N, moments in N m
    arena_camera: int
    chase_cameras: tuple[int, int]  # of the first drone of each side
    mass: np.ndarray  # [A] kg
    inertia: np.ndarray  # [A, 3] kg m^2, principal moments
    axes: np.ndarray | None  # [A, 3, 3], columns: principal axes; None: they are the bodies' own
    weight: np.ndarray  # [A] N


def load_scene(sim: SimConfig, path: Path | None = None, sides: Sides = DUEL) -> Scene:
    """Compile the MJCF at `path` (default: that of `sim`) for the body and timestep of `sim`, with
    drones of these `sides`.

    Raises UserError, one line that names the file, for what is missing, wrong or cannot be flown.
    """
    written = read_written(sim, path)
    flown, names = written.flown.of_teams(sides), drone_names(sides)
    full = written.model
    if not written.whole or sides != DUEL:
        full = _arena_with(sim, written, flown, sides)
    controls = control_columns(full, names)
    with naming_the_setting(sim):
        set_controls(sim, full, flown, controls)
        if sides == DUEL:
            refuse_other_wrench(written.path, full)
    mass = np.array([body.mass for body in flown.bodies])
    aligned = all(body.axes == ALIGNED for body in flown.bodies)
    body_id = lambda name: full.body(name).id
    first = [names[team(sides, side).start] for side in DUEL]
    cameras = [
        full.camera(name).id for name in (CAMERAS[0], *(f"{drone}_chase" for drone in first))
    ]
    drones = range(len(sides))
    return Scene(
        path=written.path,
        full=full,
        lean=rigid_bodies(flown, sim.timestep, for_mjx=True, names=names),
        flown=flown,
        rotors=written.rotors,
        sides=sides,
        qpos=tuple(slice(7 * drone, 7 * drone + 7) for drone in drones),
        qvel=tuple(slice(6 * drone, 6 * drone + 6) for drone in drones),
        bodies=tuple(body_id(name) for name in names),
        target_body=body_id(TARGET),
        target_mocap=int(full.body_mocapid[body_id(TARGET)]),
        controls=controls,
        arena_camera=cameras[0],
        chase_cameras=(cameras[1], cameras[2]),
        mass=mass,
        inertia=np.array([body.inertia for body in flown.bodies]),
        axes=None if aligned else np.array([body.rotation for body in flown.bodies]),
        weight=mass * flown.gravity,
    )


def _arena_with(sim: SimConfig, written: Written, flown: Flown, sides: Sides) -> mujoco.MjModel:
    """The package's arena with a drone of `flown` in each place; the file's own, where it is one."""
    arena, names = find_mjcf_dir() / "combat.xml", drone_names(sides)
    if written.whole and written.path != arena:
        rule = "holds one defender and one attacker; more fly the package's scene, or a file with"
        raise UserError(f"sim.mjcf: {written.path}: {rule} one drone (not {spelt(sides)})")
    spec = parse_arena(arena, sides)
    if sides == DUEL:
        require_names(arena, spec)
    places = dict(zip(names, flown.bodies, strict=True))
    if written.whole:
        for name, body in places.items():
            set_inertial(spec.body(name), body)
    else:
        own_drone.hang(spec, written.path, written.own_name, written.drones[0], places, flown)
    apply_game(sim, spec)
    model = mjcf.compiled(written.path, spec)
    # of the file's own drone: its looks add nothing to the flight
    read_flown(arena, model, read_drones(model, names))
    return model
