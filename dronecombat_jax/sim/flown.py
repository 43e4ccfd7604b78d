"""The numbers of an MJCF that a flight depends on: masses, inertias, gravity, fluid.

What lives here: the numbers, how they differ from the package's own scene, and the lean model that
is made of nothing else. What does not: reading them from a file (`written`), steps (`flight`).
"""

from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from dronecombat_jax.config.sides import Sides

DRONES = ("defender", "attacker")
ALIGNED = (1.0, 0.0, 0.0, 0.0)  # principal axes that are the body's own

# Mass in kg and inertia in kg m^2 about the body's axes, for `sim.body`; "isaac" is what
# mjcf/combat.xml says. firmware: bitcraze/crazyflie-firmware, CF_MASS of platform_defaults_cf2.h
# (0.029 since the 2.1+, 0.027 before) and J of controller_lee.c (identified by J. Foerster, ETH
# Zurich, 2015). upgrade: the firmware's mass with the thrust upgrade kit, and the same J, as none is
# published for it. brushless: CF_MASS of platform_defaults_cf21bl.h (with guards, 350 mAh and the
# Lighthouse deck); J of utiasDSL/drone-models, data/params.toml, cf21B_500. racer: Agilicious'
# Kingfisher, parameters/quads/kingfisher.yaml. Their rotors: `rotors`.
BODIES: dict[str, tuple[float, tuple[float, float, float]]] = {
    "isaac": (0.0282, (2.1236e-5, 2.1320e-5, 3.5412e-5)),
    "firmware": (0.029, (1.6571710e-5, 1.6655602e-5, 2.9261652e-5)),
    "menagerie": (0.027, (2.3951e-5, 2.3951e-5, 3.2347e-5)),
    "p250": (0.0318, (1.68e-5, 1.68e-5, 2.98e-5)),
    "upgrade": (0.0325, (1.6571710e-5, 1.6655602e-5, 2.9261652e-5)),
    "brushless": (0.0393, (2.5e-5, 2.8e-5, 4.9e-5)),
    "racer": (0.752, (2.5e-3, 2.1e-3, 4.3e-3)),
}

_SIGNIFICANT = 10  # digits that are compared: the last ones of a float64 depend on the processor
_OFF = ("CONTACT", "CONSTRAINT", "EULERDAMP", "EQUALITY", "FRICTIONLOSS", "LIMIT")
_OFF_IN_MJX = ("SPRING", "DAMPER", "ACTUATION", "SENSOR", "WARMSTART")


@dataclass(frozen=True)
class Body:
    """One drone as a rigid body about its centre of mass."""

    mass: float  # kg
    inertia: tuple[float, ...]  # [3] kg m^2, principal moments
    axes: tuple[float, ...] = ALIGNED  # [4] wxyz, principal axes to the body's

    @property
    def rotation(self) -> np.ndarray:
        """[3, 3]; its columns are the principal axes in the body's frame."""
        matrix = np.empty(9)
        mujoco.mju_quat2Mat(matrix, np.asarray(self.axes))
        return matrix.reshape(3, 3)

    @property
    def tensor(self) -> np.ndarray:
        """Inertia [3, 3] about the body's axes."""
        return self.rotation @ np.diag(self.inertia) @ self.rotation.T


@dataclass(frozen=True)
class Flown:
    """All of a scene that a step of the physics depends on."""

    bodies: tuple[Body, ...]  # [A]; of a file: defender, attacker
    gravity: float = 9.81  # m/s^2, downwards
    density: float = 0.0  # kg/m^3, of the fluid around
    viscosity: float = 0.0  # Pa s
    wind: tuple[float, ...] = (0.0, 0.0, 0.0)  # [3] m/s, world frame

    @property
    def in_fluid(self) -> bool:
        """Whether anything but thrust and gravity pushes a drone."""
        return self.density > 0.0 or self.viscosity > 0.0

    def of_teams(self, sides: Sides) -> "Flown":
        """The same with a body for each drone, where there is one for each side."""
        return replace(self, bodies=tuple(self.bodies[side] for side in sides))

    @property
    def pair(self) -> "Flown":
        """The same with one body for each side; team mates are alike."""
        return replace(self, bodies=(self.bodies[0], self.bodies[-1]))


def package_scene(body: str) -> Flown:
    """The numbers of the package's own mjcf/ for a choice of `sim.body`."""
    return Flown((Body(*BODIES[body]), Body(*BODIES[body])))


def differences(flown: Flown, body: str) -> dict[str, Any]:
    """The numbers of `flown` that differ from the package's for this `sim.body`, by dotted key;
    plain JSON.
    """
    ours, theirs = _described(flown.pair), _described(package_scene(body))
    return {key: value for key, value in ours.items() if theirs.get(key) != value}


def rigid_bodies(
    flown: Flown, timestep: float, *, for_mjx: bool = False, names: tuple[str, ...] = DRONES
) -> mujoco.MjModel:
    """A model of free rigid bodies, `names` [A], and nothing else.

    `for_mjx`: without the fluid, which `flight` adds, and as MJX steps it fastest.
    """
    spec = mujoco.MjSpec()
    option = spec.option
    option.timestep, option.gravity = timestep, (0.0, 0.0, -flown.gravity)
    option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    for bit in (*_OFF, *_OFF_IN_MJX) if for_mjx else _OFF:
        option.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{bit}"))
    if for_mjx:
        option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE  # faster in MJX even at this size
    else:
        option.density, option.viscosity = flown.density, flown.viscosity
        option.wind = flown.wind
    for name, body in zip(names, flown.bodies, strict=True):
        free = spec.worldbody.add_body(name=name)
        free.add_freejoint(name=name)
        set_inertial(free, body)
    return spec.compile()


def set_inertial(spec: mujoco.MjsBody, body: Body) -> None:
    """Give a body of a specification the mass and inertia of `body`, about its origin."""
    spec.mass, spec.inertia, spec.explicitinertial = body.mass, body.inertia, True
    spec.fullinertia = np.full(6, np.nan)
    spec.ipos, spec.iquat = np.zeros(3), np.asarray(body.axes)


def _described(flown: Flown) -> dict[str, Any]:
    """Every number by its dotted key, rounded; no key for what has no effect."""
    numbers: dict[str, Any] = {"scene.gravity": flown.gravity}
    if flown.in_fluid:
        numbers |= {"scene.density": flown.density, "scene.viscosity": flown.viscosity}
        if any(flown.wind):
            numbers["scene.wind"] = flown.wind
    for name, body in zip(DRONES, flown.bodies, strict=True):
        numbers |= {f"scene.{name}.mass": body.mass, f"scene.{name}.inertia": _inertia(body)}
        if flown.in_fluid and body.axes != ALIGNED:  # drag is along them
            numbers[f"scene.{name}.axes"] = body.axes
    return {key: _rounded(value) for key, value in numbers.items()}


def _rounded(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_rounded(number) for number in value]
    return float(f"{value:.{_SIGNIFICANT}g}")


def _inertia(body: Body) -> tuple[float, ...]:
    """As MJCF spells it: xx, yy, zz, and with axes that are not the body's also xy, xz, yz."""
    if body.axes == ALIGNED:
        return body.inertia
    tensor = body.tensor
    tensor[np.abs(tensor) < 1e-9 * tensor.max()] = 0.0
    return tuple(map(float, (*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2])))
