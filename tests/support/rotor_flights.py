"""Rotors, drag and one rigid body in double precision NumPy, from the published equations.

Written apart from the package: each rotor has a place and a turning sense, allocation is a linear
system, and the attitude is a rotation matrix. Only the order of a substep is the package's: rotors,
forces, velocities, pose (semi-implicit Euler, with MuJoCo's implicit gyroscopic torque).
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.sim.flown import BODIES
from dronecombat_jax.sim.rotors import ROTORS

GRAVITY = np.array([0.0, 0.0, -9.81])
# Front right, back right, back left, front left; the first turns against the clock, which turns the
# body with it.
PLACES = np.array([[1, -1], [-1, -1], [-1, 1], [1, 1]], float)
SENSES = np.array([-1.0, 1.0, -1.0, 1.0])


class Flight(NamedTuple):
    position: np.ndarray
    attitude: Rotation
    velocity: np.ndarray
    rate: np.ndarray
    speeds: np.ndarray


def allocation(body: str) -> np.ndarray:
    """[4, 4]: thrust and moments (rows) of each rotor's newton (columns): r x F, and the torque."""
    r = ROTORS[body]
    columns = []
    for place, sense in zip(PLACES, SENSES, strict=True):
        arm = np.array([place[0] * r.arm_x, place[1] * r.arm_y, 0.0])
        moment = np.cross(arm, [0.0, 0.0, 1.0])
        moment[2] += sense * r.torque_ratio
        columns.append([1.0, *moment])
    return np.array(columns).T


def capped(body: str, thrusts: np.ndarray) -> np.ndarray:
    """The firmware's powerDistributionCap, rotor by rotor."""
    r, highest = ROTORS[body], max(thrusts)
    reduction = highest - r.max_thrust if highest > r.max_thrust else 0.0
    return np.array([max(thrust - reduction, r.min_thrust) for thrust in thrusts])


def wanted(sim: SimConfig, flight: Flight, action: np.ndarray) -> np.ndarray:
    """Thrusts [4] in N that `action` [4] asks for."""
    body, r = sim.body, ROTORS[sim.body]
    mass, inertia = BODIES[body][0], np.array(BODIES[body][1])
    between = lambda u: r.min_thrust + (r.max_thrust - r.min_thrust) * (u + 1) / 2
    if sim.actuation == "rotors":
        return between(action)
    if sim.actuation == "mixed":
        thrust = sim.thrust_to_weight * mass * 9.81 * (action[0] + 1) / 2
        moment = sim.moment_scale * action[1:]
    else:
        thrust, w = 4 * between(action[0]), flight.rate
        lag = max(r.lag_up, r.lag_down)
        damping = max(0.0, 1.6 * np.sqrt(r.rate_gain * lag) - 1.0)
        now = (allocation(body) @ (r.max_thrust * flight.speeds**2))[1:]
        turning = (now - np.cross(w, inertia * w)) / inertia
        turn = r.rate_gain * (np.array(r.max_rates) * action[1:] - w) - damping * turning
        moment = inertia * turn + np.cross(w, inertia * w)
    return capped(body, np.linalg.solve(allocation(body), [thrust, *moment]))


def spun(sim: SimConfig, flight: Flight, action: np.ndarray) -> np.ndarray:
    """The rotors' speeds [4] after one substep."""
    r = ROTORS[sim.body]
    goal = np.sqrt(wanted(sim, flight, action) / r.max_thrust)
    if sim.battery:
        volts = sim.battery - r.battery_drop * np.mean(flight.speeds**3)
        goal = np.minimum(goal, volts / r.full_voltage)
    lag = np.where(goal > flight.speeds, r.lag_up, r.lag_down)
    return goal + (flight.speeds - goal) * np.exp(-sim.timestep / lag)


def substep(sim: SimConfig, flight: Flight, action: np.ndarray) -> Flight:
    """One physics step of one drone without wind."""
    h, r = sim.timestep, ROTORS[sim.body]
    mass, inertia = BODIES[sim.body][0], np.diag(BODIES[sim.body][1])
    speeds = spun(sim, flight, action)
    thrust, *moment = allocation(sim.body) @ (r.max_thrust * speeds**2)
    turned = flight.attitude.as_matrix()
    drag = turned @ np.diag(r.drag) @ turned.T if sim.drag else np.zeros((3, 3))
    force = thrust * turned[:, 2] + mass * GRAVITY - drag @ flight.velocity
    velocity = flight.velocity + h * np.linalg.solve(mass * np.eye(3) + h * drag, force)
    w = flight.rate
    jacobian = inertia + h * (cross_matrix(w) @ inertia - cross_matrix(inertia @ w))
    rate = w + np.linalg.solve(jacobian, h * (np.array(moment) - np.cross(w, inertia @ w)))
    return Flight(
        flight.position + h * velocity,
        flight.attitude * Rotation.from_rotvec(h * rate),
        velocity,
        rate,
        speeds,
    )


def cross_matrix(v: np.ndarray) -> np.ndarray:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0.0]])


def flown(sim: SimConfig, start: Flight, actions: np.ndarray) -> list[Flight]:
    """The states after each control step of `actions` [T, 4]."""
    path: list[Flight] = []
    for action in actions:
        for _ in range(sim.substeps):
            start = substep(sim, start, np.clip(action, -1, 1))
        path.append(start)
    return path


def at_hover(sim: SimConfig, **changed: Any) -> Flight:
    """Level, at rest, at the origin, with the rotors at the speed of hover."""
    each = BODIES[sim.body][0] * 9.81 / 4
    speeds = np.full(4, np.sqrt(each / ROTORS[sim.body].max_thrust))
    rest = Flight(np.zeros(3), Rotation.identity(), np.zeros(3), np.zeros(3), speeds)
    return rest._replace(**changed)
