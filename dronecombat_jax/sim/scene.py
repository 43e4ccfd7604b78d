"""MJCF to MuJoCo models, and names to indices, once, at load.

Two models come from one file: the full one for viewers, renderers and C MuJoCo, and a lean one
(two rigid bodies, nothing else) that MJX steps. What a file says of its drones: `written`; forces and substeps:
`flight`, MJX: `physics`.
"""

import functools
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from dronecombat_jax.config import SimConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.sim import mjcf, own_drone
from dronecombat_jax.sim.flown import (
    ALIGNED,
    BODIES,
    DRONES,
    Body,
    Flown,
    rigid_bodies,
    set_inertial,
)
from dronecombat_jax.sim.wrench import ACTUATORS, control_columns, refuse_other_wrench, set_controls
from dronecombat_jax.sim.written import Drone, read_drone, read_flown

TARGET = "target"
CAMERAS = ("arena", "defender_chase", "attacker_chase")


@dataclass(frozen=True, eq=False)
class Written:
    """A file as C MuJoCo flies it, at the game's time step, and what of it the game flies."""

    path: Path
    model: mujoco.MjModel
    drones: tuple[Drone, Drone]  # of a file that holds one drone, twice the same
    flown: Flown
    whole: bool  # a scene with both drones and the target, not one drone

    @property
    def own_name(self) -> str:
        """The name of the first drone's body in the file."""
        return self.model.body(self.drones[0].root).name


@dataclass(frozen=True, eq=False)
class Scene:
    """Both models of one MJCF and the indices into them; drones are in the order of `DRONES`.

    `qpos`, `qvel` hold in both models; body, mocap, control and camera indices are the full model's.
    """

    path: Path
    full: mujoco.MjModel
    lean: mujoco.MjModel
    flown: Flown  # every number that a step depends on
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
    axes: (
        np.ndarray | None
    )  # [A, 3, 3], columns: principal axes in the body's frame; None: the body's own
    weight: np.ndarray  # [A] N


def find_mjcf_dir() -> Path:
    """Folder of the scene's MJCF: inside the installed package, else beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "mjcf", package.parent / "mjcf"):
        if (folder / "combat.xml").is_file():
            return folder
    raise UserError(f"combat.xml: not found in {package / 'mjcf'} nor in {package.parent / 'mjcf'}")


def files_of(sim: SimConfig) -> list[Path]:
    """Every file that the scene of `sim` is made of."""
    with _naming_the_setting(sim):
        own = mjcf.files_of(Path(sim.mjcf)) if sim.mjcf else []
    return [*mjcf.files_of(find_mjcf_dir() / "combat.xml"), *own]


def flown_of(sim: SimConfig) -> Flown:
    """Every number of the scene of `sim` that a step depends on; files that are unchanged are read once."""
    stamps = [
        (str(file), (there := file.stat()).st_size, there.st_mtime_ns) for file in files_of(sim)
    ]
    return _flown_of(sim, tuple(stamps))


@functools.lru_cache(maxsize=64)
def _flown_of(sim: SimConfig, stamps: tuple[tuple[str, int, int], ...]) -> Flown:
    return read_written(sim).flown


def load_scene(sim: SimConfig, path: Path | None = None) -> Scene:
    """Compile the MJCF at `path` (default: that of `sim`) for the body and timestep of `sim`.

    Raises UserError, one line that names the file, for anything that is missing, wrong or cannot be flown in it.
    """
    written = read_written(sim, path)
    flown = written.flown
    full = written.model if written.whole else _arena_with(sim, written)
    with _naming_the_setting(sim):
        set_controls(sim, full, flown)
        refuse_other_wrench(written.path, full)
    mass = np.array([body.mass for body in flown.bodies])
    aligned = all(body.axes == ALIGNED for body in flown.bodies)
    return Scene(
        path=written.path,
        full=full,
        lean=rigid_bodies(flown, sim.timestep, for_mjx=True),
        flown=flown,
        qpos=(slice(0, 7), slice(7, 14)),
        qvel=(slice(0, 6), slice(6, 12)),
        bodies=(_body(full, DRONES[0]), _body(full, DRONES[1])),
        target_body=_body(full, TARGET),
        target_mocap=int(full.body_mocapid[_body(full, TARGET)]),
        controls=control_columns(full),
        arena_camera=full.camera("arena").id,
        chase_cameras=(full.camera("defender_chase").id, full.camera("attacker_chase").id),
        mass=mass,
        inertia=np.array([body.inertia for body in flown.bodies]),
        axes=None if aligned else np.array([body.rotation for body in flown.bodies]),
        weight=mass * flown.gravity,
    )


def read_written(sim: SimConfig, path: Path | None = None) -> Written:
    """The file at `path` (default: that of `sim`), and what of it is flown. Raises UserError as `load_scene`."""
    path = Path(path or sim.mjcf or find_mjcf_dir() / "combat.xml")
    with _naming_the_setting(sim):
        mjcf.files_of(path)
        spec = mjcf.parse(path)
        whole = {body.name for body in spec.bodies} & {*DRONES, TARGET}
        return (_read_scene if whole else _read_own_drone)(sim, path, spec)


@contextmanager
def _naming_the_setting(sim: SimConfig) -> Iterator[None]:
    """What is wrong with a file of the user's is wrong with the setting that names it."""
    try:
        yield
    except UserError as error:
        raise UserError(f"sim.mjcf: {error.message}" if sim.mjcf else error.message) from None


def _read_scene(sim: SimConfig, path: Path, spec: mujoco.MjSpec) -> Written:
    """A whole scene, like mjcf/combat.xml."""
    _require_names(path, spec)
    _apply(sim, spec)
    if sim.body != "isaac":
        for name in DRONES:
            set_inertial(spec.body(name), Body(*BODIES[sim.body]))
    model = mjcf.compiled(path, spec)
    _check_joints(path, model)
    drones = read_drone(model, _body(model, DRONES[0])), read_drone(model, _body(model, DRONES[1]))
    for name, drone in zip(DRONES, drones, strict=True):
        if np.abs(drone.centre).max() > 1e-9:
            place = " ".join(f"{x:g}" for x in drone.centre)
            raise UserError(
                f"{path}: body {name}: its centre of mass must be the body's origin, not {place}"
            )
    return Written(path, model, drones, read_flown(path, model, drones), whole=True)


def _read_own_drone(sim: SimConfig, path: Path, spec: mujoco.MjSpec) -> Written:
    """A file with one drone."""
    name = own_drone.free_body(path, spec)
    _apply(sim, spec)
    spec.option.disableflags |= int(
        mujoco.mjtDisableBit.mjDSBL_ACTUATION
    )  # the wrench is the game's
    model = mjcf.compiled(path, spec)
    drone = read_drone(model, _body(model, name))
    return Written(
        path, model, (drone, drone), read_flown(path, model, (drone, drone)), whole=False
    )


def _arena_with(sim: SimConfig, written: Written) -> mujoco.MjModel:
    """The package's arena with the file's drone in both places."""
    arena = find_mjcf_dir() / "combat.xml"
    spec = mjcf.parse(arena)
    _require_names(arena, spec)
    own_drone.hang(spec, written.path, written.own_name, written.drones[0], written.flown)
    _apply(sim, spec)
    model = mjcf.compiled(written.path, spec)
    read_flown(
        arena,
        model,
        (read_drone(model, _body(model, DRONES[0])), read_drone(model, _body(model, DRONES[1]))),
    )
    return model


def _require_names(path: Path, spec: mujoco.MjSpec) -> None:
    """Every name that the package resolves must exist; the error lists those that do."""
    required = {
        "body": (spec.bodies, (*DRONES, TARGET)),
        "joint": (spec.joints, DRONES),
        "actuator": (spec.actuators, ACTUATORS),
        "camera": (spec.cameras, CAMERAS),
    }
    for kind, (elements, names) in required.items():
        there = [element.name for element in elements if element.name]
        missing = [name for name in names if name not in there]
        if missing:
            raise UserError(
                f"{path}: no {kind} named {', '.join(missing)} (there are: {', '.join(there) or 'none'})"
            )


def _apply(sim: SimConfig, spec: mujoco.MjSpec) -> None:
    """What the game says whatever the file does: time step, integrator, body axes as written, no contacts."""
    spec.option.timestep, spec.option.integrator = sim.timestep, mujoco.mjtIntegrator.mjINT_IMPLICIT
    spec.compiler.alignfree = False
    for joint in spec.joints:
        joint.align = mujoco.mjtAlignFree.mjALIGNFREE_FALSE
    for bit in ("CONTACT", "CONSTRAINT", "EULERDAMP"):
        spec.option.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{bit}"))


def _check_joints(path: Path, model: mujoco.MjModel) -> None:
    """One free joint for each drone, defender first; a mocap target."""
    for name in DRONES:
        joint = model.joint(name)
        if joint.type[0] != mujoco.mjtJoint.mjJNT_FREE or joint.bodyid[0] != _body(model, name):
            raise UserError(f"{path}: joint {name} must be the free joint of body {name}")
    if (model.nq, model.nv) != (14, 12) or model.joint(DRONES[0]).qposadr[0] != 0:
        joints = ", ".join(model.joint(index).name or f"#{index}" for index in range(model.njnt))
        raise UserError(
            f"{path}: the only joints must be defender, then attacker (there are: {joints})"
        )
    if model.body_mocapid[_body(model, TARGET)] < 0:
        raise UserError(f'{path}: body {TARGET} must be mocap="true"')


def _body(model: mujoco.MjModel, name: str) -> int:
    return model.body(name).id
