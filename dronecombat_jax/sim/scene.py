"""MJCF to MuJoCo models, and names to indices, once, at load.

Two models come from one file: the full one for viewers, renderers and C MuJoCo, and a lean one
(two rigid bodies, nothing else) that MJX steps. Forces and substeps live in `flight`, MJX in `physics`.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from dronecombat_jax.config import SimConfig
from dronecombat_jax.errors import UserError

DRONES = ("defender", "attacker")
TARGET = "target"
CONTROLS = ("thrust", "moment_x", "moment_y", "moment_z")

# Mass in kg and diagonal inertia in kg m^2, for `sim.body`; "isaac" is what the MJCF itself says.
# firmware: bitcraze/crazyflie-firmware, CF_MASS of platform_defaults_cf2.h (0.029 since the 2.1+,
# 0.027 before) and J of controller_lee.c (identified by J. Foerster, ETH Zurich, 2015).
BODIES: dict[str, tuple[float, tuple[float, float, float]]] = {
    "firmware": (0.029, (1.6571710e-5, 1.6655602e-5, 2.9261652e-5)),
    "menagerie": (0.027, (2.3951e-5, 2.3951e-5, 3.2347e-5)),
    "p250": (0.0318, (1.68e-5, 1.68e-5, 2.98e-5)),
}

_DISABLED = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
_DISABLED |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP


@dataclass(frozen=True, eq=False)
class Scene:
    """Both models of one MJCF and the indices into them; drones are in the order of `DRONES`.

    `qpos`, `qvel` hold in both models; body, mocap, control and camera indices are the full model's.
    """

    path: Path
    full: mujoco.MjModel
    lean: mujoco.MjModel
    qpos: tuple[slice, slice]  # 7 each: xyz in m (world), quaternion wxyz
    qvel: tuple[slice, slice]  # 6 each: m/s in the world frame, rad/s in the body frame
    bodies: tuple[int, int]
    target_body: int
    target_mocap: int  # row of `mocap_pos`
    controls: np.ndarray  # [A, 4] columns of ctrl: thrust in N, moments in N m
    arena_camera: int
    chase_cameras: tuple[int, int]
    mass: np.ndarray  # [A] kg
    inertia: np.ndarray  # [A, 3] kg m^2, body axes
    weight: np.ndarray  # [A] N


def find_mjcf_dir() -> Path:
    """Folder of the scene's MJCF: inside the installed package, else beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "mjcf", package.parent / "mjcf"):
        if (folder / "combat.xml").is_file():
            return folder
    raise UserError(f"combat.xml: not found in {package / 'mjcf'} nor in {package.parent / 'mjcf'}")


def load_scene(sim: SimConfig, path: Path | None = None) -> Scene:
    """Compile the MJCF at `path` (default: the package's arena) for the body and timestep of `sim`.

    Raises UserError, one line that names the file, for anything that is missing or wrong in it.
    """
    path = find_mjcf_dir() / "combat.xml" if path is None else Path(path)
    _check_files(path)
    spec = _parse(path)
    _require_names(path, spec)
    _apply(sim, spec)
    full = _compile(path, spec)
    _check_bodies(path, full)
    _set_controls(sim, full)
    lean = _compile(path, _strip(_parse_again(path, sim)))
    bodies = (_body(full, DRONES[0]), _body(full, DRONES[1]))
    mass = np.array([full.body_mass[body] for body in bodies])
    return Scene(
        path=path,
        full=full,
        lean=lean,
        qpos=(slice(0, 7), slice(7, 14)),
        qvel=(slice(0, 6), slice(6, 12)),
        bodies=bodies,
        target_body=_body(full, TARGET),
        target_mocap=int(full.body_mocapid[_body(full, TARGET)]),
        controls=_control_columns(full),
        arena_camera=full.camera("arena").id,
        chase_cameras=(full.camera("defender_chase").id, full.camera("attacker_chase").id),
        mass=mass,
        inertia=np.array([full.body_inertia[body] for body in bodies]),
        weight=mass * float(np.linalg.norm(full.opt.gravity)),
    )


def _parse_again(path: Path, sim: SimConfig) -> mujoco.MjSpec:
    # A compiled spec keeps ids of what is deleted from it later, hence a fresh one.
    spec = _parse(path)
    _apply(sim, spec)
    return spec


def _check_files(path: Path) -> None:
    """Refuse absent files, malformed XML and references that leave the folder of `path`."""
    root = path.resolve().parent
    pending, seen = [(path.resolve(), "")], set()
    while pending:
        file, parent = pending.pop()
        if file in seen:
            continue
        seen.add(file)
        if not file.is_file():
            there = ", ".join(sorted(other.name for other in root.glob("*.xml"))) or "none"
            raise UserError(f"{file}: no such file{parent} (MJCF files in {root}: {there})")
        try:
            tree = ElementTree.fromstring(file.read_bytes())
        except ElementTree.ParseError as error:
            raise UserError(f"{file}: not well-formed XML: {_one_line(error)}") from None
        folders = [
            Path(compiler.get(key, ""))
            for compiler in tree.iter("compiler")
            for key in ("assetdir", "meshdir", "texturedir")
        ]
        for element in tree.iter():
            name = element.get("file")
            if name is None:
                continue
            for folder in [Path(), *folders]:
                if not (root / folder / name).resolve().is_relative_to(root):
                    raise UserError(f'{file}: <{element.tag} file="{name}"> leaves the folder {root}')
            if element.tag in ("include", "model"):
                pending.append(((root / name).resolve(), f", which {file} names"))


def _parse(path: Path) -> mujoco.MjSpec:
    try:
        return mujoco.MjSpec.from_file(str(path))
    except (ValueError, OSError) as error:
        raise UserError(f"{path}: {_one_line(error)}") from None


def _compile(path: Path, spec: mujoco.MjSpec) -> mujoco.MjModel:
    try:
        return spec.compile()
    except (ValueError, OSError) as error:
        raise UserError(f"{path}: {_one_line(error)}") from None


def _require_names(path: Path, spec: mujoco.MjSpec) -> None:
    """Every name that the package resolves must exist; the error lists those that do."""
    required = {
        "body": (spec.bodies, (*DRONES, TARGET)),
        "joint": (spec.joints, DRONES),
        "actuator": (spec.actuators, [f"{drone}_{control}" for drone in DRONES for control in CONTROLS]),
        "camera": (spec.cameras, ("arena", "defender_chase", "attacker_chase")),
    }
    for kind, (elements, names) in required.items():
        there = [element.name for element in elements if element.name]
        missing = [name for name in names if name not in there]
        if missing:
            raise UserError(f"{path}: no {kind} named {', '.join(missing)} (there are: {', '.join(there) or 'none'})")


def _apply(sim: SimConfig, spec: mujoco.MjSpec) -> None:
    """Timestep, body alternative, and no contacts or constraints whatever the file says."""
    spec.option.timestep = sim.timestep
    spec.option.disableflags |= int(_DISABLED)
    if sim.body in BODIES:
        mass, inertia = BODIES[sim.body]
        for name in DRONES:
            body = spec.body(name)
            body.mass, body.inertia, body.explicitinertial = mass, inertia, True
            body.fullinertia = np.full(6, np.nan)
            body.ipos, body.iquat = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])


def _strip(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Keep two free rigid bodies: the same flight, and all that MJX has to carry and to step."""
    groups = ("keys", "sensors", "actuators", "sites", "geoms", "cameras", "lights", "materials", "textures")
    for group in groups:
        for element in list(getattr(spec, group)):
            spec.delete(element)
    spec.delete(spec.body(TARGET))
    option, disable = spec.option, mujoco.mjtDisableBit
    option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE  # faster in MJX even at this size
    for bit in (
        disable.mjDSBL_EQUALITY,
        disable.mjDSBL_FRICTIONLOSS,
        disable.mjDSBL_LIMIT,
        disable.mjDSBL_SPRING,
        disable.mjDSBL_DAMPER,
        disable.mjDSBL_ACTUATION,
        disable.mjDSBL_SENSOR,
        disable.mjDSBL_WARMSTART,
    ):
        option.disableflags |= int(bit)
    return spec


def _check_bodies(path: Path, model: mujoco.MjModel) -> None:
    """One free rigid body per drone, defender first, inertia along body axes; a mocap target."""
    for name in DRONES:
        body = _body(model, name)
        mass, inertia = float(model.body_mass[body]), model.body_inertia[body]
        if not (math.isfinite(mass) and mass > 0.0 and np.all(np.isfinite(inertia)) and np.all(inertia > 0.0)):
            raise UserError(f"{path}: body {name}: mass {mass} kg and inertia {inertia.tolist()} must be above 0")
        if np.any(model.body_ipos[body] != 0.0) or np.any(model.body_iquat[body] != (1.0, 0.0, 0.0, 0.0)):
            raise UserError(f"{path}: body {name}: its inertial must sit at the body's origin, along the body's axes")
        joint = model.joint(name)
        if joint.type[0] != mujoco.mjtJoint.mjJNT_FREE or joint.bodyid[0] != body:
            raise UserError(f"{path}: joint {name} must be the free joint of body {name}")
    if (model.nq, model.nv) != (14, 12) or model.joint(DRONES[0]).qposadr[0] != 0:
        joints = ", ".join(model.joint(index).name or f"#{index}" for index in range(model.njnt))
        raise UserError(f"{path}: the only joints must be defender, then attacker (there are: {joints})")
    if model.body_mocapid[_body(model, TARGET)] < 0:
        raise UserError(f'{path}: body {TARGET} must be mocap="true"')


def _set_controls(sim: SimConfig, model: mujoco.MjModel) -> None:
    """Limits of eq. 7 and 8 for this body (thrust up to `thrust_to_weight`), and its hover in every keyframe."""
    columns = _control_columns(model)
    gravity = float(np.linalg.norm(model.opt.gravity))
    for name, row in zip(DRONES, columns, strict=True):
        weight = model.body_mass[_body(model, name)] * gravity
        model.actuator_ctrlrange[row[0]] = (0.0, sim.thrust_to_weight * weight)
        model.actuator_ctrlrange[row[1:]] = (-sim.moment_scale, sim.moment_scale)
        model.key_ctrl[:, row[0]] = weight


def _control_columns(model: mujoco.MjModel) -> np.ndarray:
    return np.array([[model.actuator(f"{drone}_{control}").id for control in CONTROLS] for drone in DRONES])


def _body(model: mujoco.MjModel, name: str) -> int:
    return model.body(name).id


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
