"""A file that holds one drone: hung into the package's arena twice, by its centre of mass.

The file gives mass, inertia, gravity, fluid and looks. Its actuators, sensors, keyframes and the
world around it are left out; the wrench is the game's. What of it cannot be flown: `written`.
"""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from dronecombat_jax.errors import UserError
from dronecombat_jax.sim import mjcf
from dronecombat_jax.sim.flown import ALIGNED, DRONES, Body, Flown, set_inertial
from dronecombat_jax.sim.written import Drone

_HIDDEN, _DRONES = 5, 2  # visual groups: never drawn; drawn where drones have their true size
_SIZES = ("memory", "nuserdata", "nuser_body", "nuser_geom")
_ACTING = ("actuators", "tendons", "equalities", "flexes", "plugins", "excludes", "pairs")
_UNSEEN = ("keys", "sensors", "skins", "joints", "cameras", "lights", "sites")


def free_body(path: Path, spec: mujoco.MjSpec) -> str:
    """The name of the body with the file's only joint, made where it has none; or UserError."""
    joints = list(spec.joints)
    free = [joint for joint in joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    if not free:
        raise UserError(
            f"{path}: no free joint: it must hold one drone, a body with a free joint, "
            f"or a whole scene with bodies {', '.join(DRONES)} and target"
        )
    if len(joints) > 1:
        named = [f"{joint.name or 'unnamed'} of body {joint.parent.name}" for joint in joints]
        listed = ", ".join(named)
        raise UserError(f"{path}: a drone's free joint must be its only joint (not {listed})")
    body = free[0].parent
    body.name = body.name or "drone"
    return body.name


def hang(
    arena: mujoco.MjSpec, path: Path, name: str, drone: Drone, bodies: dict[str, Body], flown: Flown
) -> None:
    """Put the drone `name` of the file at `path` into the places of `bodies` in the package's arena."""
    option = arena.option
    option.gravity, option.wind = (0.0, 0.0, -flown.gravity), flown.wind
    option.density, option.viscosity = flown.density, flown.viscosity
    for place, body in bodies.items():
        outer = arena.body(place)
        set_inertial(outer, body)
        for geom in outer.geoms:
            geom.group = _HIDDEN  # the package's Crazyflie, which `report.stage` draws enlarged
        frame = outer.add_frame(pos=-drone.centre)
        try:
            frame.attach_body(_looks(arena, path, name), f"{place}_own_", "")
        except ValueError as error:
            message = f"body {name} cannot be put into the arena: {' '.join(str(error).split())}"
            raise UserError(f"{path}: {message}") from None


def _looks(arena: mujoco.MjSpec, path: Path, name: str) -> Any:
    """The file's drone without mass, contacts and joints; its options are those of `arena`."""
    spec = mjcf.parse(path)
    free_body(path, spec)
    for group in (*_ACTING, *_UNSEEN):
        for element in list(getattr(spec, group)):
            spec.delete(element)
    compiler = spec.compiler  # an attached body keeps it, and would get a mass by these
    compiler.boundmass, compiler.boundinertia, compiler.settotalmass = 0.0, 0.0, -1.0
    for settings in ("option", "visual", "stat", *_SIZES):  # MuJoCo warns of each that differs
        _copy(getattr(arena, settings), spec, settings)
    body = spec.body(name)
    body.pos, body.quat = np.zeros(3), np.array(ALIGNED)  # where it starts in its own file
    body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    for part in (body, *body.find_all("body")):
        part.explicitinertial, part.mass, part.inertia = False, 0.0, np.zeros(3)
        part.gravcomp = 0.0
    for geom in body.find_all("geom"):
        geom.mass, geom.density, geom.fluid_ellipsoid = 0.0, 0.0, 0.0
        geom.contype, geom.conaffinity = 0, 0
        if geom.group > _DRONES:
            spec.delete(geom)
        else:
            geom.group = _DRONES
    return body


def _copy(value: Any, owner: Any, name: str) -> None:
    """Set `owner.name` to `value`, field by field where it is a structure."""
    if isinstance(value, int | float | np.ndarray):
        setattr(owner, name, value)
        return
    for field in dir(value):
        if not field.startswith("_") and not callable(getattr(value, field)):
            _copy(getattr(value, field), getattr(owner, name), field)
