"""Which MJCF a setting names, and what is read out of it: a whole scene, or one drone.

What lives here: files, required names and joints, and the choices that the game makes whatever a
file says. What does not: what of it can be flown (`written`), the models made of it (`scene`).
"""

import functools
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from dronecombat_jax.config.body_file import is_file
from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.sim import mjcf, own_drone
from dronecombat_jax.sim.bodies import NEUTRAL, require_rotors, rigid_body, rotors_of
from dronecombat_jax.sim.flown import ALIGNED, DRONES, Flown, set_inertial
from dronecombat_jax.sim.mjcf_rotors import rotors_in
from dronecombat_jax.sim.rotors import Rotors
from dronecombat_jax.sim.wrench import ACTUATORS
from dronecombat_jax.sim.written import Drone, read_drone, read_flown

TARGET = "target"
CAMERAS = ("arena", "defender_chase", "attacker_chase")


@dataclass(frozen=True, eq=False)
class Written:
    """A file as C MuJoCo flies it, at the game's time step, and what of it the game flies."""

    path: Path
    model: mujoco.MjModel
    drones: tuple[Drone, ...]  # two; of a file that holds one drone, twice the same
    flown: Flown
    whole: bool  # a scene with both drones and the target, not one drone
    rotors: Rotors | None = None  # None: nothing says enough of them

    @property
    def own_name(self) -> str:
        """The name of the first drone's body in the file."""
        return self.model.body(self.drones[0].root).name


def find_mjcf_dir() -> Path:
    """Folder of the package's MJCF: inside it where it is installed, else beside it."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "mjcf", package.parent / "mjcf"):
        if (folder / "combat.xml").is_file():
            return folder
    raise UserError(f"combat.xml: not found in {package / 'mjcf'} nor in {package.parent / 'mjcf'}")


def files_of(sim: SimConfig) -> list[Path]:
    """Every file that the scene of `sim` is made of. Raises UserError as `read_written`."""
    with naming_the_setting(sim):
        own = mjcf.files_of(Path(sim.mjcf)) if sim.mjcf else []
    own += [Path(sim.body).expanduser()] if is_file(sim.body) else []
    return [*mjcf.files_of(find_mjcf_dir() / "combat.xml"), *own]


def flown_of(sim: SimConfig) -> tuple[Flown, Rotors | None]:
    """Every number of the scene of `sim` that a step depends on; unchanged files are read once."""
    stamps = []
    for file in files_of(sim):
        if not file.is_file():
            raise UserError(f"sim.body: {file}: no such file")
        stamps.append((str(file), file.stat().st_size, file.stat().st_mtime_ns))
    return _flown_of(sim, tuple(stamps))


@functools.lru_cache(maxsize=64)
def _flown_of(
    sim: SimConfig, stamps: tuple[tuple[str, int, int], ...]
) -> tuple[Flown, Rotors | None]:
    written = read_written(sim)
    return written.flown, written.rotors


def read_written(sim: SimConfig, path: Path | None = None) -> Written:
    """The file at `path` (default: that of `sim`), and what of it is flown.

    Raises UserError, one line that names the file and what is missing, wrong or cannot be flown.
    """
    path = Path(path or sim.mjcf or find_mjcf_dir() / "combat.xml")
    with naming_the_setting(sim):
        mjcf.files_of(path)
        spec = mjcf.parse(path)
        whole = {body.name for body in spec.bodies} & {*DRONES, TARGET}
        return (_read_scene if whole else _read_own_drone)(sim, path, spec)


@contextmanager
def naming_the_setting(sim: SimConfig) -> Generator[None]:
    """Turn an error in a user's file into an error of the setting that names the file."""
    try:
        yield
    except UserError as error:
        if sim.mjcf and not error.message.startswith("sim."):
            raise UserError(f"sim.mjcf: {error.message}") from None
        raise


def require_names(path: Path, spec: mujoco.MjSpec) -> None:
    """Every name that the package resolves must exist; the error lists those that do."""
    required = {
        "body": (spec.bodies, (*DRONES, TARGET)),
        "joint": (spec.joints, DRONES),
        "actuator": (spec.actuators, ACTUATORS),
        "camera": (spec.cameras, CAMERAS),
    }
    for kind, (elements, names) in required.items():
        present = [element.name for element in elements if element.name]
        missing = ", ".join(name for name in names if name not in present)
        if missing:
            listed = ", ".join(present) or "none"
            raise UserError(f"{path}: no {kind} named {missing} (there are: {listed})")


def apply_game(sim: SimConfig, spec: mujoco.MjSpec) -> None:
    """Set what the game decides, whatever the file says: step, integrator, axes as written, no
    contacts.
    """
    option = spec.option
    option.timestep, option.integrator = sim.timestep, mujoco.mjtIntegrator.mjINT_IMPLICIT
    spec.compiler.alignfree = False
    for joint in spec.joints:
        joint.align = mujoco.mjtAlignFree.mjALIGNFREE_FALSE
    for bit in ("CONTACT", "CONSTRAINT", "EULERDAMP"):
        option.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{bit}"))


def read_drones(model: mujoco.MjModel, names: tuple[str, ...] = DRONES) -> tuple[Drone, ...]:
    """The drones of a compiled scene."""
    return tuple(read_drone(model, model.body(name).id) for name in names)


def _read_scene(sim: SimConfig, path: Path, spec: mujoco.MjSpec) -> Written:
    """A whole scene, like mjcf/combat.xml."""
    require_names(path, spec)
    apply_game(sim, spec)
    if sim.body != NEUTRAL and not sim.mjcf:
        for name in DRONES:
            set_inertial(spec.body(name), rigid_body(sim.body))
    model = mjcf.compiled(path, spec)
    _check_joints(path, model)
    drones = read_drones(model)
    for name, drone in zip(DRONES, drones, strict=True):
        if np.abs(drone.centre).max() > 1e-9:
            place = f"the body's origin, not {' '.join(f'{x:g}' for x in drone.centre)}"
            raise UserError(f"{path}: body {name}: its centre of mass must be {place}")
    flown = read_flown(path, model, drones)
    return Written(path, model, drones, flown, whole=True, rotors=_rotors(sim, flown, {}))


def _read_own_drone(sim: SimConfig, path: Path, spec: mujoco.MjSpec) -> Written:
    """A file with one drone; its actuators are off, since the wrench is the game's."""
    name = own_drone.free_body(path, spec)
    apply_game(sim, spec)
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    model = mjcf.compiled(path, spec)
    drone = read_drone(model, model.body(name).id)
    flown = read_flown(path, model, (drone, drone))
    rotors = _rotors(sim, flown, rotors_in(model, drone))
    return Written(path, model, (drone, drone), flown, whole=False, rotors=rotors)


def _rotors(sim: SimConfig, flown: Flown, of_mjcf: dict[str, Any]) -> Rotors | None:
    """What flies the drones of `flown`. UserError where `sim` needs more than is said."""
    rotors, missing = rotors_of(sim, of_mjcf)
    require_rotors(sim, rotors, missing)
    if sim.drag and any(body.axes != ALIGNED for body in flown.bodies):
        raise UserError(
            "sim.drag = true: it is along the body's axes, which must be its principal ones"
        )
    return rotors


def _check_joints(path: Path, model: mujoco.MjModel) -> None:
    """One free joint for each drone, defender first; a mocap target."""
    for name in DRONES:
        joint, body = model.joint(name), model.body(name).id
        if joint.type[0] != mujoco.mjtJoint.mjJNT_FREE or joint.bodyid[0] != body:
            raise UserError(f"{path}: joint {name} must be the free joint of body {name}")
    if (model.nq, model.nv) != (14, 12) or model.joint(DRONES[0]).qposadr[0] != 0:
        joints = ", ".join(model.joint(index).name or f"#{index}" for index in range(model.njnt))
        rule = "the only joints must be defender, then attacker"
        raise UserError(f"{path}: {rule} (there are: {joints})")
    if model.body_mocapid[model.body(TARGET).id] < 0:
        raise UserError(f'{path}: body {TARGET} must be mocap="true"')
