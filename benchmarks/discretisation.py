"""What the time step loses: our flight and C MuJoCo's `implicit` beside an exact integration.

    python -m benchmarks.discretisation [--timestep 0.01] [--substeps 2] [--axes 32]

Prints two Markdown tables. The first: which share of rotational energy and of angular momentum a
drone keeps that tumbles without torque, mean [least, most] over random axes at the start; exactly
it keeps all of both. The second: how far a drone that flies gently is from the exact motion. The
exact one is SciPy's DOP853 in double precision at a relative tolerance of 1e-10.

What does not live here: the tests that our flight is C MuJoCo's (`tests/sim/test_flight.py`).
"""

import argparse
from collections.abc import Sequence
from functools import cache
from itertools import groupby
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.machine import backend

ALTITUDE = 10.0  # m
FREE = (-1.0, 0.0, 0.0, 0.0)  # the action without thrust and moments
SECONDS = (1.0, 4.0)


class Flight(NamedTuple):
    """One drone's start and actions; it starts level, without velocity."""

    rate: NDArray[np.float64]  # [3] rad/s at the start, about body axes
    action: NDArray[np.float64]  # [T, 4]
    name: str = ""


class Path(NamedTuple):
    """After every control step."""

    position: NDArray[np.float64]  # [T, 3] m
    rate: NDArray[np.float64]  # [T, 3] rad/s, about body axes


def main() -> None:
    """Read the flags, fly, print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    default = SimConfig()
    add = parser.add_argument
    add("--timestep", type=float, default=default.timestep, help="in s (%(default)s)")
    add("--substeps", type=int, default=default.substeps, help="of an action (%(default)s)")
    add("--axes", type=int, default=32, help="of the tumbling (%(default)s)")
    flags = parser.parse_args()
    backend.prepare("cpu")
    sim = SimConfig(timestep=flags.timestep, substeps=flags.substeps)
    print(f"time step {sim.timestep:g} s, {sim.substeps} substeps an action\n")
    tumbling_table(sim, flags.axes)
    print()
    gentle_table(sim)


def tumbling_table(sim: SimConfig, axes: int) -> None:
    """Energy and momentum that are left: in our flight, in C MuJoCo, exactly."""
    kinds = ("ours", "C MuJoCo", "exact")
    columns = [f"{what} kept: {kind}" for what in ("energy", "momentum") for kind in kinds]
    print(f"| tumbling at | after | {' | '.join(columns)} |\n|{'---|' * (2 + len(columns))}")
    for speed in (20.0, 100.0):
        flights = tumbles(sim, speed, SECONDS[-1], axes)
        apart = ([fly(sim, flight) for flight in flights] for fly in (c_mujoco, exact))
        paths = [ours(sim, flights), *apart]
        for seconds in SECONDS:
            kept = np.array([shares_kept(sim, flights, flown, seconds) for flown in paths])
            cells = [spread(shares) for shares in kept.transpose(2, 0, 1).reshape(-1, axes)]
            print(f"| {speed:g} rad/s | {seconds:g} s | {' | '.join(cells)} |", flush=True)


def gentle_table(sim: SimConfig) -> None:
    """How far from the exact motion a second of gentle flight ends."""
    print("| gentle flight of 1 s | from the exact motion: ours | C MuJoCo | it flew |")
    print("|---|---|---|---|")
    for flight in gentle(sim):
        truth = exact(sim, flight).position[-1]
        flown = [ours(sim, [flight])[0].position[-1], c_mujoco(sim, flight).position[-1]]
        apart = " | ".join(f"{np.linalg.norm(position - truth):.4f} m" for position in flown)
        print(f"| {flight.name} | {apart} | {np.linalg.norm(truth - [0, 0, ALTITUDE]):.2f} m |")


def tumbles(sim: SimConfig, speed: float, seconds: float, axes: int) -> list[Flight]:
    """Free falls that start turning at `speed` rad/s about random axes."""
    directions = np.random.default_rng(0).normal(size=(axes, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    action = np.tile(FREE, (_steps(sim, seconds), 1))
    return [Flight(speed * axis, action) for axis in directions]


def spread(values: NDArray) -> str:
    """Mean and range, where there is any."""
    mean, low, high = (f"{value:.3f}" for value in (values.mean(), values.min(), values.max()))
    return mean if low == high else f"{mean} [{low}, {high}]"


def gentle(sim: SimConfig) -> list[Flight]:
    """Flights of 1 s with small body rates: straight up at full thrust, and a dash."""
    steps = _steps(sim, 1.0)
    up = np.tile((1.0, 0.0, 0.0, 0.0), (steps, 1))
    dash = up.copy()
    quarter = steps // 4
    dash[:quarter, 2], dash[quarter : 2 * quarter, 2] = 0.02, -0.02  # tilts, and stops to tilt
    still = np.zeros(3)
    rise = Flight(still, up, "straight up, full thrust")
    return [rise, Flight(still, dash, "dash: tilted forward, full thrust")]


def shares_kept(
    sim: SimConfig,
    flights: Sequence[Flight],
    paths: Sequence[Path],
    seconds: float,
) -> NDArray[np.float64]:
    """The shares [N, 2] of rotational energy and of angular momentum left after `seconds`."""
    inertia, last = _scene(sim).inertia[0], _steps(sim, seconds) - 1
    start = np.stack([flight.rate for flight in flights])
    end = np.stack([path.rate[last] for path in paths])
    energy = [np.sum(inertia * rate**2, axis=1) for rate in (start, end)]
    momentum = [np.linalg.norm(inertia * rate, axis=1) for rate in (start, end)]
    return np.stack([energy[1] / energy[0], momentum[1] / momentum[0]], axis=1)


def ours(sim: SimConfig, flights: Sequence[Flight]) -> list[Path]:
    """As training flies it: `sim.flight`, float32; all `flights` are equally long."""
    import jax

    from dronecombat_jax.sim.flight import build_step, split

    step = jax.vmap(build_step(sim, _scene(sim)))

    def advance(state, action):
        state = step(state[0], state[1], action)
        return state, state

    action = np.stack([flight.action for flight in flights], axis=1)[:, :, None]
    action = action.repeat(2, axis=2).astype(np.float32)  # both drones fly it
    start = [np.stack(part).astype(np.float32) for part in zip(*map(_start, flights), strict=True)]
    fly = jax.jit(lambda start, action: jax.lax.scan(advance, start, action)[1])
    drones = split(*fly(tuple(start), action))
    position, rate = (np.asarray(part[:, :, 0], float) for part in (drones.position, drones.rate))
    return [Path(position[:, index], rate[:, index]) for index in range(len(flights))]


def c_mujoco(sim: SimConfig, flight: Flight) -> Path:
    """C MuJoCo's `implicit` in double precision, through the actuators of the full scene."""
    scene = _scene(sim)
    data = mujoco.MjData(scene.full)
    data.qpos[:], data.qvel[:] = _start(flight)
    low, high = scene.full.actuator_ctrlrange[scene.controls].transpose(2, 0, 1)
    path = []
    for action in flight.action:
        data.ctrl[scene.controls] = low + (action + 1) / 2 * (high - low)
        mujoco.mj_step(scene.full, data, sim.substeps)
        path.append((data.qpos[:3].copy(), data.qvel[3:6].copy()))
    return Path(*(np.stack(part) for part in zip(*path, strict=True)))


def exact(sim: SimConfig, flight: Flight) -> Path:
    """Integrate m v' = T z - m g, I w' = M - w x I w, q' = q (0, w) / 2.

    Thrust T is along body z; moment M, inertia I and rate w are about body axes.
    """
    scene = _scene(sim)
    mass, inertia, weight = float(scene.mass[0]), scene.inertia[0], float(scene.weight[0])

    def derivative(_: float, state: NDArray, thrust: float, moment: NDArray) -> NDArray:
        velocity, rate = state[7:10], state[10:]
        w, x, y, z = state[3:7] / np.linalg.norm(state[3:7])
        p, q, r = rate
        turn = np.array(
            [
                -x * p - y * q - z * r,
                w * p + y * r - z * q,
                w * q + z * p - x * r,
                w * r + x * q - y * p,
            ]
        )
        up = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        force = thrust * up - np.array([0.0, 0.0, weight])
        torque = moment - _cross(rate, inertia * rate)
        return np.concatenate([velocity, turn / 2, force / mass, torque / inertia])

    state = np.concatenate([[0, 0, ALTITUDE, 1], np.zeros(6), flight.rate])
    dt, path = sim.timestep * sim.substeps, []
    options = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-11}
    for action, group in groupby(flight.action, key=tuple):  # as long as the wrench stays
        ends = dt * np.arange(1, 1 + len(list(group)))
        thrust = sim.thrust_to_weight * weight * (action[0] + 1) / 2
        wrench = thrust, sim.moment_scale * np.array(action[1:])
        span = (0.0, float(ends[-1]))
        solved = solve_ivp(derivative, span, state, t_eval=ends, args=wrench, **options)
        state = solved.y[:, -1]
        path.append(solved.y.T)
    whole = np.concatenate(path)
    return Path(whole[:, :3], whole[:, 10:])


def _cross(a: NDArray, b: NDArray) -> NDArray:
    """a x b; for one pair NumPy's own takes many times as long."""
    x = a[1] * b[2] - a[2] * b[1]
    y = a[2] * b[0] - a[0] * b[2]
    return np.array([x, y, a[0] * b[1] - a[1] * b[0]])


def _start(flight: Flight) -> tuple[NDArray, NDArray]:
    """`qpos` [14] and `qvel` [12] of two drones that fly the same, 5 m apart."""
    pose = [0, 0, ALTITUDE, 1, 0, 0, 0]
    return np.array([*pose, 5.0, *pose[1:]], float), np.tile([*np.zeros(3), *flight.rate], 2)


def _steps(sim: SimConfig, seconds: float) -> int:
    return round(seconds / (sim.timestep * sim.substeps))


@cache
def _scene(sim: SimConfig):
    from dronecombat_jax.sim.scene import load_scene

    return load_scene(sim)


if __name__ == "__main__":
    main()
