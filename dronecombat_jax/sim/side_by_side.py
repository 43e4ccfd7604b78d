"""One second of flight twice: by the game, and by C MuJoCo on the file as it is written.

C MuJoCo flies the user's own model, its bodies, frames and fluid, by its `implicit` integrator; the
same wrench acts at the centre of mass. What is said about it: `inspection`.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.sim.flight import build_step, split
from dronecombat_jax.sim.flown import DRONES
from dronecombat_jax.sim.scene import Scene
from dronecombat_jax.sim.source import Drone, Written

SECONDS = 1.0
# At the start, of defender and attacker: a gentle flight, and a fast one in which a fluid shows.
SPEED = (2.0, 12.0)  # m/s
SPIN = (2.0, 8.0)  # rad/s about each axis
TURN = 30.0  # rad/s^2, the most by a moment: rates stay below the game's cap, which C MuJoCo lacks


class Difference(NamedTuple):
    """The largest differences between the game and C MuJoCo within the second, for one drone."""

    position: float  # m
    rate: float  # rad/s
    flown: float  # m, how far the drone got


def differences(sim: SimConfig, scene: Scene, written: Written) -> tuple[Difference, Difference]:
    """How far the game's flight is from C MuJoCo's, for the defender and for the attacker."""
    steps = max(1, round(SECONDS / (sim.timestep * sim.substeps)))
    qvel, actions = _start(), _actions(sim, scene, steps)
    ours = _by_the_game(sim, scene, qvel, actions)
    by_c = lambda index: _by_c_mujoco(sim, scene, written, index, qvel[index], actions[:, index])
    return _difference(0, ours, by_c(0)), _difference(1, ours, by_c(1))


def _start() -> np.ndarray:
    """Velocities and body rates [A, 6] at the start."""
    linear = np.outer(SPEED, (1.0, -0.5, 0.2))
    return np.concatenate([linear, np.outer(SPIN, (1.0, -1.0, 1.0))], axis=1)


def _actions(sim: SimConfig, scene: Scene, steps: int) -> np.ndarray:
    """Random actions [T, A, 4]: any thrust, and moments of the wrench that turn by up to `TURN`."""
    random = np.random.default_rng(0)
    most = np.array([TURN * min(body.inertia) for body in scene.flown.bodies])
    actions = random.uniform(-1.0, 1.0, (steps, len(DRONES), 4))
    actions[..., 1:] *= np.minimum(1.0, most / max(sim.moment_scale, 1e-9))[:, None]
    return actions


def _by_the_game(
    sim: SimConfig, scene: Scene, qvel: np.ndarray, actions: np.ndarray
) -> tuple[Any, ...]:
    """Positions and rates [T, A, 3] by `build_step`."""
    step = build_step(sim, scene)

    def advance(
        state: tuple[Any, ...], action: jax.Array
    ) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        state = step(state[0], state[1], action)
        return state, state

    pose = jnp.asarray([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0] * len(DRONES))
    start = pose, jnp.asarray(qvel.reshape(-1), jnp.float32)
    path = jax.jit(lambda start, actions: jax.lax.scan(advance, start, actions)[1])
    drones = split(*path(start, jnp.asarray(actions, jnp.float32)))
    return np.asarray(drones.position), np.asarray(drones.rate)


def _by_c_mujoco(
    sim: SimConfig,
    scene: Scene,
    written: Written,
    index: int,
    start: np.ndarray,
    actions: np.ndarray,
) -> tuple[Any, ...]:
    """Positions of the centre of mass and body rates [T, 3] of one drone in the file's model."""
    model: Any = written.model
    data, drone = mujoco.MjData(model), written.drones[index]
    joint, dof = model.body_jntadr[drone.root], model.body_dofadr[drone.root]
    place = model.jnt_qposadr[joint]
    data.qpos[place : place + 7] = [*-drone.centre, 1, 0, 0, 0]
    data.qvel[dof : dof + 6] = start
    data.qvel[dof : dof + 3] -= np.cross(start[3:], drone.centre)  # of the body's origin
    full_thrust = sim.thrust_to_weight * scene.weight[index]
    positions, rates = [], []
    for action in actions:
        thrust, moment = full_thrust * (action[0] + 1.0) / 2.0, sim.moment_scale * action[1:]
        for _ in range(sim.substeps):
            _apply_wrench(model, data, drone, thrust, moment)
            mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        turn = data.xmat[drone.root].reshape(3, 3)
        positions.append(data.xpos[drone.root] + turn @ drone.centre)
        rates.append(data.qvel[dof + 3 : dof + 6].copy())
    return np.array(positions), np.array(rates)


def _apply_wrench(model: Any, data: Any, drone: Drone, thrust: float, moment: np.ndarray) -> None:
    """Thrust along body z at the centre of mass and a moment about body axes, for the next step."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    turn = data.xmat[drone.root].reshape(3, 3)
    point = data.xpos[drone.root] + turn @ drone.centre
    force, torque = turn[:, 2] * thrust, turn @ moment
    data.qfrc_applied[:] = 0.0
    mujoco.mj_applyFT(model, data, force, torque, point, drone.root, data.qfrc_applied)


def _difference(index: int, ours: tuple[Any, ...], theirs: tuple[Any, ...]) -> Difference:
    farthest = lambda a, b: float(np.linalg.norm(a[:, index] - b, axis=-1).max())
    position, rate = (farthest(a, b) for a, b in zip(ours, theirs, strict=True))
    return Difference(position, rate, float(np.linalg.norm(theirs[0][-1])))
