"""What a compiled MJCF says of its drones, and what of it cannot be flown.

What lives here: the rigid body that a drone's bodies make together, gravity and fluid, and the
refusals: whatever C MuJoCo would do with the file and the game would not. What does not: files
(`mjcf`), a scene's names (`scene`), its actuators (`wrench`).
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
_PASSIVE = mujoco.mjtDisableBit.mjDSBL_SPRING | mujoco.mjtDisableBit.mjDSBL_DAMPER
_JOINT_FORCES = {
    "stiffness": ("jnt_stiffness", "jnt_stiffnesspoly"),
    "damping": ("dof_damping", "dof_dampingpoly"),
    "armature": ("dof_armature",),
    "frictionloss": ("dof_frictionloss",),
}
_TENDON_FORCES = ("stiffness", "damping", "frictionloss", "armature", "limited")
_TENDON_FIELDS = [f"tendon_{name}" for name in (*_TENDON_FORCES, "stiffnesspoly", "dampingpoly")]
_ACTUATOR_FIELDS = ("actuator_damping", "actuator_dampingpoly", "actuator_armature")


class Drone(NamedTuple):
    """One drone of a compiled model."""

    root: int  # index of the body with the free joint
    centre: np.ndarray  # [3] m, its centre of mass in that body's frame
    body: Body


def read_drone(model: Any, root: int) -> Drone:
    """The rigid body that `root` and the bodies welded to it make together."""
    heavy = [index for index in _members(model, root) if _has_inertia(model, index)]
    if heavy == [root]:
        mass, inertia = float(model.body_mass[root]), tuple(map(float, model.body_inertia[root]))
        body = Body(mass, inertia, tuple(map(float, model.body_iquat[root])))
        return Drone(root, model.body_ipos[root].copy(), _in_order_of_axes(body))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    turn, origin = data.xmat[root].reshape(3, 3), data.xpos[root]
    masses, places = model.body_mass[heavy], (data.xipos[heavy] - origin) @ turn
    centre = masses @ places / masses.sum()
    tensor = np.zeros((3, 3))
    for index, mass, arm in zip(heavy, masses, places - centre, strict=True):
        axes = turn.T @ data.ximat[index].reshape(3, 3)
        tensor += axes @ np.diag(model.body_inertia[index]) @ axes.T
        tensor += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))  # parallel axes
    moments, axes = np.linalg.eigh(tensor)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    turned = np.empty(4)
    mujoco.mju_mat2Quat(turned, np.ascontiguousarray(axes).ravel())
    body = Body(float(masses.sum()), tuple(map(float, moments)), tuple(map(float, turned)))
    return Drone(root, centre, _in_order_of_axes(body))


def read_flown(path: Path, model: Any, drones: tuple[Drone, ...]) -> Flown:
    """The numbers that a flight depends on. Raises UserError that names what cannot be flown."""
    option = model.opt
    flown = Flown(tuple(drone.body for drone in drones), -float(option.gravity[2]))
    if option.disableflags & _PASSIVE != _PASSIVE and (option.density > 0 or option.viscosity > 0):
        wind = tuple(map(float, option.wind))
        fluid = float(option.density), float(option.viscosity), wind
        flown = Flown(flown.bodies, flown.gravity, *fluid)
    if faults := list(_faults(model, {drone.root for drone in drones}, flown.in_fluid)):
        more = f"; and {len(faults) - _NAMED} more" if len(faults) > _NAMED else ""
        listed = "; ".join(faults[:_NAMED])
        raise UserError(f"{path}: cannot be flown as written: {listed}{more}")
    for index, drone in enumerate(drones):
        _refuse_other_motion(path, model, drone, index, flown)
    return flown


def name_of(model: Any, kind: str, index: Any) -> str:
    """The name of an element, or its number where it has none."""
    return getattr(model, kind)(index).name or f"#{index}"


def _members(model: Any, root: int) -> np.ndarray:
    """`root` and every body below it."""
    return np.flatnonzero(model.body_rootid == root)


def _has_inertia(model: Any, body: int) -> bool:
    """Whether a body has mass, or an inertia without mass, which MuJoCo allows inside another."""
    return bool(model.body_mass[body] > 0.0 or np.any(model.body_inertia[body] > 0.0))


def _in_order_of_axes(body: Body) -> Body:
    """The same with its moments in the order of the body's axes, where the axes are those lines."""
    tensor = body.tensor
    moments = np.diag(tensor)
    if body.axes == ALIGNED or np.abs(tensor - np.diag(moments)).max() > _EXACT * moments.max():
        return body
    return Body(body.mass, tuple(map(float, moments)))


def _faults(model: Any, roots: set[int], in_fluid: bool) -> Iterator[str]:
    """One phrase for each element that moves a drone in C MuJoCo and that the game does not fly."""
    yield from _option_faults(model)
    for root in sorted(roots):
        dofs = model.body_dofadr[root] + np.arange(6)
        index = {"jnt": model.body_jntadr[root], "dof": dofs}
        faults = [
            word
            for word, fields in _JOINT_FORCES.items()
            if any(_acts(model, field, index[field[:3]]) for field in fields)
        ]
        if faults:
            yield f"the free joint of body {name_of(model, 'body', root)}: {', '.join(faults)}"
        for body in _members(model, root):
            yield from _body_faults(model, body, root, in_fluid)
    for index in range(model.nactuator):
        if any(_acts(model, field, index) for field in _ACTUATOR_FIELDS):
            yield f"actuator {name_of(model, 'actuator', index)}: damping or armature"
    for index in range(model.ntendon):
        if any(_acts(model, field, index) for field in _TENDON_FIELDS):
            yield f"tendon {name_of(model, 'tendon', index)}"
    yield from (f"equality {name_of(model, 'eq', i)}" for i in np.flatnonzero(model.eq_active0))
    yield from (f"flex #{index}" for index in range(model.nflex))


def _option_faults(model: Any) -> Iterator[str]:
    gravity = model.opt.gravity
    if np.any(gravity[:2]) or not gravity[2] < 0.0:
        spelt = " ".join(f"{component:g}" for component in gravity)
        yield f"option gravity {spelt}: it must point down along z, which is what a drone senses"
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
        yield 'option flag gravity="disable"'
    if model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP:
        yield 'option flag sleep="enable"'


def _body_faults(model: Any, body: int, root: int, in_fluid: bool) -> Iterator[str]:
    name = name_of(model, "body", body)
    if model.body_gravcomp[body]:
        yield f"body {name}: gravcomp"
    if model.body_plugin[body] >= 0:
        yield f"body {name}: plugin"
    if in_fluid and body != root and _has_inertia(model, body):
        fused = 'write <compiler fusestatic="true"/>, or density and viscosity 0'
        yield f"body {name}: a body with mass inside another, each with its own drag ({fused})"
    for geom in np.flatnonzero(model.geom_bodyid == body):
        if in_fluid and model.geom_fluid[geom, 0] > 0.0:
            yield f'geom {name_of(model, "geom", geom)}: fluidshape="ellipsoid"'


def _acts(model: Any, field: str, index: Any) -> bool:
    """Whether a field of an element is not 0; where this MuJoCo has no such field, it is 0."""
    return hasattr(model, field) and bool(np.any(getattr(model, field)[index]))


def _refuse_other_motion(path: Path, model: Any, drone: Drone, index: int, flown: Flown) -> None:
    """Raise UserError unless the drone accelerates in C MuJoCo as a free rigid body does: this
    catches what the list does not name.

    Compared are the centre of mass and the rates of the file's drone with those of a body made of
    `flown` alone, at drawn poses and velocities. Raises UserError.
    """
    names = tuple(map(str, range(len(flown.bodies))))
    plain, model = rigid_bodies(flown, model.opt.timestep, names=names), copy.copy(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)  # `wrench` looks at those
    for seed in range(3):
        random = np.random.default_rng(seed)
        pose = np.concatenate([random.uniform(-5, 5, 3), q := random.normal(size=4)])
        pose[3:] /= np.linalg.norm(q)
        velocity, rate = random.uniform(-10, 10, (2, 3))
        theirs, turn = _acceleration(model, drone.root, pose, velocity, rate)
        swing = np.cross(rate, drone.centre)  # of the centre of mass about the body's origin
        theirs[:3] += turn @ (np.cross(theirs[3:], drone.centre) + np.cross(rate, swing))
        ours, _ = _acceleration(plain, 1 + index, pose, velocity + turn @ swing, rate)
        if not np.allclose(theirs, ours, rtol=1e-6, atol=1e-6 * np.abs(ours).max()):
            raise UserError(
                f"{path}: body {name_of(model, 'body', drone.root)}: something in the file moves "
                "it otherwise than its mass, inertia, gravity and the fluid do: "
                f"{_spelt(theirs)}, not {_spelt(ours)}"
            )


def _acceleration(
    model: Any, root: int, pose: np.ndarray, velocity: np.ndarray, rate: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Acceleration [6] of a free body in one state, by C MuJoCo, and its rotation [3, 3]."""
    data = mujoco.MjData(model)
    joint, dof = model.body_jntadr[root], model.body_dofadr[root]
    start = model.jnt_qposadr[joint]
    data.qpos[start : start + 7] = pose
    data.qvel[dof : dof + 6] = np.concatenate([velocity, rate])
    mujoco.mj_forward(model, data)
    return data.qacc[dof : dof + 6].copy(), data.xmat[root].reshape(3, 3).copy()


def _spelt(acceleration: np.ndarray) -> str:
    linear, angular = np.round(acceleration, 4).reshape(2, 3).tolist()
    return f"{linear} m/s^2 and {angular} rad/s^2"
