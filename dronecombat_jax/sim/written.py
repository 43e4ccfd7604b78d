"""What a compiled MJCF says of its drones, and what of it cannot be flown.

What lives here: the rigid body that a drone's bodies make together, gravity and fluid, and the refusals: whatever
C MuJoCo would do with the file and the game would not. What does not: files (`mjcf`), actuators (`wrench`).
"""

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from dronecombat_jax.errors import UserError
from dronecombat_jax.sim.flown import ALIGNED, Body, Flown, rigid_bodies

_NAMED = 4  # faults in a message
_EXACT = 1e-9  # relative size of what is rounding


class Drone(NamedTuple):
    """One drone of a compiled model."""

    root: int  # index of the body with the free joint
    centre: np.ndarray  # [3] m, its centre of mass in that body's frame
    body: Body


def read_drone(model: Any, root: int) -> Drone:
    """The rigid body that `root` and the bodies welded to it make together."""
    heavy = [index for index in _members(model, root) if model.body_mass[index] > 0.0]
    if heavy == [root]:
        inertia, axes = _along_body(model.body_inertia[root], model.body_iquat[root])
        return Drone(
            root, model.body_ipos[root].copy(), Body(float(model.body_mass[root]), inertia, axes)
        )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    turn, origin = data.xmat[root].reshape(3, 3), data.xpos[root]
    mass, places = model.body_mass[heavy], (data.xipos[heavy] - origin) @ turn
    centre = mass @ places / mass.sum()
    tensor = np.zeros((3, 3))
    for index, own, place in zip(heavy, mass, places - centre, strict=True):
        axes = turn.T @ data.ximat[index].reshape(3, 3)
        tensor += axes @ np.diag(model.body_inertia[index]) @ axes.T
        tensor += own * (place @ place * np.eye(3) - np.outer(place, place))  # parallel axes
    inertia, axes = _principal(tensor)
    return Drone(root, centre, Body(float(mass.sum()), inertia, axes))


def read_flown(path: Path, model: Any, drones: tuple[Drone, Drone]) -> Flown:
    """The numbers that a flight depends on. Raises UserError, one line that names what cannot be flown."""
    off = mujoco.mjtDisableBit.mjDSBL_SPRING | mujoco.mjtDisableBit.mjDSBL_DAMPER
    without_passive = model.opt.disableflags & off == off  # then C MuJoCo has no fluid either
    density, viscosity = (
        (0.0, 0.0) if without_passive else (float(model.opt.density), float(model.opt.viscosity))
    )
    flown = Flown(
        (drones[0].body, drones[1].body), -float(model.opt.gravity[2]), density, viscosity
    )
    if flown.in_fluid:
        flown = Flown(
            flown.bodies, flown.gravity, density, viscosity, tuple(map(float, model.opt.wind))
        )
    if faults := list(_faults(model, [drone.root for drone in drones], flown.in_fluid)):
        more = f"; and {len(faults) - _NAMED} more" if len(faults) > _NAMED else ""
        raise UserError(f"{path}: cannot be flown as written: {'; '.join(faults[:_NAMED])}{more}")
    for index, drone in enumerate(drones):
        _refuse_other_accelerations(path, model, drone, index, flown)
    return flown


def name_of(model: Any, kind: str, index: int) -> str:
    """The name of an element, or its number where it has none."""
    return getattr(model, kind)(index).name or f"#{index}"


def _members(model: Any, root: int) -> np.ndarray:
    """`root` and every body below it."""
    return np.flatnonzero(model.body_rootid == root)


def _along_body(inertia: np.ndarray, axes: np.ndarray) -> tuple[Any, Any]:
    """Principal moments and axes, in the order of the body's axes where they are the same lines."""
    body = Body(1.0, tuple(map(float, inertia)), tuple(map(float, axes)))
    if body.axes == ALIGNED or not _is_diagonal(body.tensor):
        return body.inertia, body.axes
    return tuple(map(float, np.diag(body.tensor))), ALIGNED


def _principal(tensor: np.ndarray) -> tuple[Any, Any]:
    """Principal moments and axes (wxyz) of a symmetric tensor."""
    if _is_diagonal(tensor):
        return tuple(map(float, np.diag(tensor))), ALIGNED
    moments, axes = np.linalg.eigh(tensor)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(axes).ravel())
    return tuple(map(float, moments)), tuple(map(float, quaternion))


def _is_diagonal(tensor: np.ndarray) -> bool:
    return bool(np.all(np.abs(tensor - np.diag(np.diag(tensor))) < _EXACT * tensor.max()))


def _faults(model: Any, roots: list[int], in_fluid: bool) -> Iterator[str]:
    """One phrase for each element that acts on a drone in C MuJoCo and that the game does not fly."""
    yield from _option_faults(model)
    for root in dict.fromkeys(roots):
        yield from _joint_faults(model, root)
        for body in _members(model, root):
            yield from _body_faults(model, body, root, in_fluid)
    for index in range(model.nu):
        if np.any(model.actuator_damping[index]) or _any(
            model, index, "actuator_dampingpoly", "actuator_armature"
        ):
            yield f"actuator {name_of(model, 'actuator', index)}: damping and armature"
    forces = (
        "stiffness",
        "stiffnesspoly",
        "damping",
        "dampingpoly",
        "frictionloss",
        "armature",
        "limited",
    )
    for index in range(model.ntendon):
        if _any(model, index, *(f"tendon_{force}" for force in forces)):
            yield f"tendon {name_of(model, 'tendon', index)}"
    for index in np.flatnonzero(model.eq_active0):
        yield f"equality {name_of(model, 'eq', index)}"
    yield from (f"flex #{index}" for index in range(model.nflex))


def _option_faults(model: Any) -> Iterator[str]:
    gravity = model.opt.gravity
    if np.any(gravity[:2]) or not gravity[2] < 0.0:
        yield f"option gravity {' '.join(f'{g:g}' for g in gravity)}: it must point down along z, as what a drone sees does"
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
        yield 'option flag gravity="disable"'
    if model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP:
        yield 'option flag sleep="enable"'


def _joint_faults(model: Any, root: int) -> Iterator[str]:
    joint, dofs = model.body_jntadr[root], model.body_dofadr[root] + np.arange(6)
    found = {
        "stiffness": _any(model, joint, "jnt_stiffness", "jnt_stiffnesspoly"),
        "damping": _any(model, dofs, "dof_damping", "dof_dampingpoly"),
        "armature": _any(model, dofs, "dof_armature"),
        "frictionloss": _any(model, dofs, "dof_frictionloss"),
    }
    if acting := [word for word, there in found.items() if there]:
        yield f"the free joint of body {name_of(model, 'body', root)}: {', '.join(acting)}"


def _body_faults(model: Any, body: int, root: int, in_fluid: bool) -> Iterator[str]:
    name = name_of(model, "body", body)
    if model.body_gravcomp[body]:
        yield f"body {name}: gravcomp"
    if model.body_plugin[body] >= 0:
        yield f"body {name}: plugin"
    if in_fluid and body != root and model.body_mass[body] > 0.0:
        fused = 'write <compiler fusestatic="true"/>, or density and viscosity 0'
        yield f"body {name}: a body with mass inside another, each with a drag of its own ({fused})"
    for geom in np.flatnonzero(model.geom_bodyid == body):
        if in_fluid and model.geom_fluid[geom, 0] > 0.0:
            yield f'geom {name_of(model, "geom", geom)}: fluidshape="ellipsoid"'


def _any(model: Any, index: Any, *fields: str) -> bool:
    """Whether any of these fields is not 0; a field that this MuJoCo does not have is 0."""
    return any(
        bool(np.any(getattr(model, field)[index])) for field in fields if hasattr(model, field)
    )


def _refuse_other_accelerations(
    path: Path, model: Any, drone: Drone, index: int, flown: Flown
) -> None:
    """The net below the list of faults: as C MuJoCo has it, the drone must accelerate as a free rigid body.

    Compared are the centre of mass and the rates of the file's drone and of a body made of `flown` alone, at random
    poses and velocities. Raises UserError.
    """
    plain = rigid_bodies(flown, model.opt.timestep)
    model = copy.copy(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)  # `wrench` looks at those
    for seed in range(3):
        random = np.random.default_rng(seed)
        pose = np.concatenate(
            [random.uniform(-5, 5, 3), (q := random.normal(size=4)) / np.linalg.norm(q)]
        )
        rate = random.uniform(-10, 10, 3)
        twist = np.concatenate([random.uniform(-10, 10, 3), rate])
        theirs, turn = _acceleration(model, drone.root, pose, twist)
        arm = np.cross(theirs[3:], drone.centre) + np.cross(rate, np.cross(rate, drone.centre))
        theirs[:3] += turn @ arm  # from the body's origin to the centre of mass
        twist[:3] += turn @ np.cross(rate, drone.centre)
        ours, _ = _acceleration(plain, 1 + index, pose, twist)
        if not np.allclose(theirs, ours, rtol=1e-6, atol=1e-6 * np.abs(ours).max()):
            spelt = lambda a: (
                f"{np.round(a[:3], 4).tolist()} m/s^2 and {np.round(a[3:], 4).tolist()} rad/s^2"
            )
            raise UserError(
                f"{path}: body {name_of(model, 'body', drone.root)}: something in the file moves it otherwise than "
                f"its mass, inertia, gravity and the fluid do: {spelt(theirs)}, not {spelt(ours)}"
            )


def _acceleration(
    model: Any, root: int, pose: np.ndarray, twist: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Of a free body at one state: [6] as C MuJoCo has it, and its rotation [3, 3]."""
    data = mujoco.MjData(model)
    joint, dof = model.body_jntadr[root], model.body_dofadr[root]
    start = model.jnt_qposadr[joint]
    data.qpos[start : start + 7], data.qvel[dof : dof + 6] = pose, twist
    mujoco.mj_forward(model, data)
    return data.qacc[dof : dof + 6].copy(), data.xmat[root].reshape(3, 3).copy()
