"""The actuators of a scene: thrust along body z, moments about the body's axes (eq. 7, 8), no more.

MJX flies without actuators (`flight` applies the wrench); viewers and C MuJoCo fly by these.
"""

import copy
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.sim.flown import DRONES, Flown
from dronecombat_jax.sim.written import name_of

CONTROLS = ("thrust", "moment_x", "moment_y", "moment_z")
ACTUATORS = tuple(f"{drone}_{control}" for drone in DRONES for control in CONTROLS)
_UNITS = ("N along z", "N m about x", "N m about y", "N m about z")


def control_columns(model: Any, drones: tuple[str, ...] = DRONES) -> np.ndarray:
    """[A, 4] columns of ctrl: thrust in N, moments in N m."""
    columns = [[model.actuator(f"{name}_{control}").id for control in CONTROLS] for name in drones]
    return np.array(columns)


def set_controls(sim: SimConfig, model: Any, flown: Flown, columns: np.ndarray) -> None:
    """Limits of eq. 7 and 8 for these bodies, and their hover in every keyframe."""
    for body, row in zip(flown.bodies, columns, strict=True):
        weight = body.mass * flown.gravity
        model.actuator_ctrlrange[row[0]] = (0.0, sim.thrust_to_weight * weight)
        model.actuator_ctrlrange[row[1:]] = (-sim.moment_scale, sim.moment_scale)
        model.key_ctrl[:, row[0]] = weight


def refuse_other_wrench(path: Path, model: Any) -> None:
    """Raise UserError, naming the actuator, unless each gives what its name says, in any pose.

    What an actuator gives is asked of C MuJoCo: gears, sites, gains, biases, limits and filters are
    all in it.
    """
    names = [name_of(model, "actuator", index) for index in range(model.nactuator)]
    if others := [name for name in names if name not in ACTUATORS]:
        raise UserError(
            f"{path}: actuator {', '.join(others)}: the game applies thrust and moments alone, "
            f"by {', '.join(ACTUATORS)}"
        )
    model = copy.copy(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
    for seed in range(2):
        data = _anywhere(model, seed)
        mujoco.mj_forward(model, data)
        for index in np.flatnonzero(data.actuator_force):
            raise UserError(f"{path}: actuator {names[index]}: it pushes without a command")
        for index, name in enumerate(ACTUATORS):
            _refuse_other_push(path, model, data, name, *divmod(index, len(CONTROLS)))


def _refuse_other_push(path: Path, model: Any, data: Any, name: str, drone: int, axis: int) -> None:
    """Raise UserError unless control `axis` of `drone` gives its force or moment alone."""
    column = model.actuator(name).id
    high = max(float(model.actuator_ctrlrange[column, 1]), 1e-6)
    for value in (high,) if axis == 0 else (high, -high):
        data.ctrl[:], data.ctrl[column] = 0.0, value
        mujoco.mj_forward(model, data)
        given = data.qfrc_actuator.reshape(len(DRONES), 6).copy()
        for index, body in enumerate(DRONES):
            given[index, :3] = given[index, :3] @ data.body(body).xmat.reshape(3, 3)
        wanted = np.zeros_like(given)
        wanted[drone, 2 if axis == 0 else 2 + axis] = value
        if not np.allclose(given, wanted, rtol=0.0, atol=1e-6 * high):
            force, moment = _spelt(given[drone, :3]), _spelt(given[drone, 3:])
            raise UserError(
                f"{path}: actuator {name}: {value:.4g} gives a force of {force} N and a moment of "
                f"{moment} N m in the body's frame; it must give {value:.4g} {_UNITS[axis]} alone"
            )


def _anywhere(model: Any, seed: int) -> Any:
    """Put both drones at some pose and velocity, so that a servo shows, whose force depends on
    them.
    """
    random, data = np.random.default_rng(seed), mujoco.MjData(model)
    data.qpos[:] = random.normal(size=model.nq)
    data.qvel[:] = random.normal(size=model.nv)
    mujoco.mj_normalizeQuat(model, data.qpos)
    return data


def _spelt(numbers: np.ndarray) -> str:
    return "(" + ", ".join(f"{number:.4g}" for number in np.round(numbers, 9) + 0.0) + ")"
