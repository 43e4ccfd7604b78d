"""Rotors in the MJCF of one drone: four actuators that each push along body z.

Asked of C MuJoCo, as gears, sites, gains and limits are all in what an actuator gives. What does
not live here: the wrench of a whole scene (`wrench`), what a file lacks (`bodies`).
"""

import copy
from typing import Any

import mujoco
import numpy as np

from dronecombat_jax.sim.written import Drone

_EXACT = 1e-6
_FILTERS = (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
_DYNAMICS = (mujoco.mjtDyn.mjDYN_NONE, *_FILTERS)


def rotors_in(model: Any, drone: Drone) -> dict[str, Any]:
    """What the actuators of `model` say of the rotors of `drone`, by key of `config.body_file`.

    `layout`: moments in N m about the centre of mass for each newton of each rotor, clockwise from
    the front right. Empty where they are not four alike rotors: thrust along body z, its moment
    about z in one ratio, one range, and a filter of first order at most.
    """
    if model.nu != 4 or not np.all(np.isin(model.actuator_dyntype, _DYNAMICS)):
        return {}
    each = np.array([_wrench(model, drone, index, 1.0) for index in range(4)])
    twice = np.array([_wrench(model, drone, index, 2.0) for index in range(4)])
    thrust = each[:, 2]
    if np.any(thrust <= 0.0) or not np.allclose(twice, 2.0 * each, rtol=_EXACT, atol=1e-12):
        return {}
    sideways = np.abs(each[:, :2]).max(axis=1)
    layout = each[:, 3:] / thrust[:, None]
    ranges = model.actuator_ctrlrange * thrust[:, None]
    ratios = np.abs(layout[:, 2])
    lags = np.where(np.isin(model.actuator_dyntype, _FILTERS), model.actuator_dynprm[:, 0], 0.0)
    alike = lambda values: np.allclose(values, values[0], rtol=_EXACT, atol=0.0)
    limited = np.all(model.actuator_ctrllimited) and np.all(ranges[:, 0] < ranges[:, 1])
    if np.any(sideways > _EXACT * thrust) or not (limited and alike(ratios) and alike(lags)):
        return {}
    if not (alike(ranges[:, 1]) and np.allclose(ranges[:, 0], ranges[0, 0])) or ratios[0] <= 0.0:
        return {}
    clockwise = np.mod(-np.arctan2(layout[:, 0], -layout[:, 1]) + 1e-6, 2.0 * np.pi)
    numbers = {
        "layout": layout[np.argsort(clockwise)],
        "min_thrust": max(float(ranges[0, 0]), 0.0),
        "max_thrust": float(ranges[0, 1]),
        "torque_ratio": float(ratios[0]),
    }
    return numbers | ({"lag_up": float(lags[0])} if lags[0] > 0.0 else {})


def _wrench(model: Any, drone: Drone, index: int, command: float) -> np.ndarray:
    """Force [3] N and moment [3] N m about the centre of mass, body frame, of one actuator."""
    model, data = copy.copy(model), mujoco.MjData(model)
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
    data.ctrl[index] = command
    if (first := model.actuator_actadr[index]) >= 0:
        data.act[first : first + model.actuator_actnum[index]] = command
    mujoco.mj_forward(model, data)
    dof = model.body_dofadr[drone.root]
    force, moment = np.split(data.qfrc_actuator[dof : dof + 6].copy(), 2)
    force = data.xmat[drone.root].reshape(3, 3).T @ force
    return np.concatenate([force, moment - np.cross(drone.centre, force)])
