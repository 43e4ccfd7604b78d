"""Actuation: what an action asks of four rotors, and what they give.

What lives here: the table `ACTUATIONS`, the mixer and its limits, the rotors' lag. What does not:
the bodies' numbers (`rotors`), the paper's ideal wrench (`flight.wrench`), the step (`craft`).
Signs and saturation as in Bitcraze's firmware, src/modules/src/power_distribution_quadrotor.c
(powerDistributionForceTorque, powerDistributionCap): rotor 1 is front right, then clockwise as seen
from above. Commands are scaled by the nominal numbers of the body, whatever a fight has drawn.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.sim.rotors import PLACES, SENSES, Rotors
from dronecombat_jax.sim.scene import Scene

# Signs of each rotor's moments about x, y, z per newton of thrust, in an X: r x F and its torque.
SIGNS = np.array([(y, -x, s) for (x, y), s in zip(PLACES, SENSES, strict=True)], np.float32)
DAMPING = 0.8  # of the rate loop and the rotors' lag as one second-order system


class Plant(NamedTuple):
    """One body as its controller knows it: nominal numbers, bound when a step is built."""

    rotors: Rotors
    inertia: jax.Array  # [A, 3] kg m^2
    weight: jax.Array  # [A] N
    full_thrust: jax.Array  # [A] N, of the paper's wrench (eq. 7)
    moment_scale: float  # N m, of the paper's wrench (eq. 8)


# (plant, clipped action [A, 4], rate [A, 3] rad/s, speeds [A, 4]) -> wanted thrusts [A, 4] in N
Command = Callable[[Plant, jax.Array, jax.Array, jax.Array], jax.Array]


def plant_of(sim: SimConfig, scene: Scene) -> Plant:
    """The nominal numbers of the body of `sim`, whose rotors `scene` holds."""
    assert scene.rotors is not None  # `load_scene` has seen to it
    weight = jnp.asarray(scene.weight, jnp.float32)
    moments = [np.diag(body.tensor) for body in scene.flown.bodies]
    inertia = jnp.asarray(np.array(moments), jnp.float32)
    full_thrust = sim.thrust_to_weight * weight
    return Plant(scene.rotors, inertia, weight, full_thrust, sim.moment_scale)


def four_thrusts(plant: Plant, action: jax.Array, rate: jax.Array, speeds: jax.Array) -> jax.Array:
    """`rotors`: each number of the action is one rotor's thrust, from its least to its most."""
    return _between(plant.rotors, action)


def mixed_wrench(plant: Plant, action: jax.Array, rate: jax.Array, speeds: jax.Array) -> jax.Array:
    """`mixed`: the paper's thrust and moments (eq. 7, 8), asked of four rotors."""
    thrust = plant.full_thrust * (action[:, 0] + 1.0) / 2.0
    return distribute(plant.rotors, thrust, plant.moment_scale * action[:, 1:])


def body_rates(plant: Plant, action: jax.Array, rate: jax.Array, speeds: jax.Array) -> jax.Array:
    """`ctbr`: collective thrust and body rates, through a proportional rate loop at every substep.

    The loop is damped by the angular acceleration that the rotors' present speeds give, in place of
    the derivative in a firmware's faster loop.
    """
    rotors = plant.rotors
    thrust = 4.0 * _between(rotors, action[:, 0])
    wanted = jnp.asarray(rotors.max_rates, action.dtype) * action[:, 1:]
    gyroscopic = jnp.cross(rate, plant.inertia * rate)
    _, present = collect(rotors, thrusts_of(rotors, speeds))
    acceleration = (present - gyroscopic) / plant.inertia
    turn = rotors.rate_gain * (wanted - rate) - rate_damping(rotors) * acceleration
    return distribute(rotors, thrust, plant.inertia * turn + gyroscopic)


ACTUATIONS: dict[str, Command | None] = {
    "wrench": None,  # ideal: `flight.wrench`
    "rotors": four_thrusts,
    "mixed": mixed_wrench,
    "ctbr": body_rates,
}


def rate_damping(rotors: Rotors) -> float:
    """What makes rate gain k and lag t a second-order system of damping `DAMPING`.

    With t a' + (1 + d) a = k e and e' = -a: 1 + d = 2 DAMPING sqrt(k t); t is the slower lag.
    """
    lag = max(rotors.lag_up, rotors.lag_down)
    return max(0.0, 2.0 * DAMPING * (rotors.rate_gain * lag) ** 0.5 - 1.0)


def collect(rotors: Rotors, thrusts: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Thrust [A] in N and moment [A, 3] in N m about the body's axes of `thrusts` [A, 4]."""
    moment = jnp.sum(thrusts[:, :, None] * jnp.asarray(_moments(rotors)), axis=1)
    return jnp.sum(thrusts, axis=-1), moment


def mix(rotors: Rotors, thrust: jax.Array, moment: jax.Array) -> jax.Array:
    """The four thrusts [A, 4] that give `thrust` [A] and `moment` [A, 3], without limits."""
    shares = jnp.asarray(_shares(rotors))
    return thrust[:, None] * shares[:, 0] + jnp.sum(shares[:, 1:] * moment[:, None, :], axis=-1)


def distribute(rotors: Rotors, thrust: jax.Array, moment: jax.Array) -> jax.Array:
    """The same within the limits: what is too much for one rotor is taken off all four, so that
    moments come before thrust; a rotor that would be under its least gets its least.
    """
    wanted = mix(rotors, thrust, moment)
    excess = jnp.maximum(jnp.max(wanted, axis=-1, keepdims=True) - rotors.max_thrust, 0.0)
    return jnp.maximum(wanted - excess, rotors.min_thrust)


def speeds_of(rotors: Rotors, thrusts: jax.Array) -> jax.Array:
    """Speeds over that of full thrust; thrust goes with the square of the speed."""
    return jnp.sqrt(jnp.maximum(thrusts, 0.0) / rotors.max_thrust)


def thrusts_of(rotors: Rotors, speeds: jax.Array) -> jax.Array:
    """Thrusts in N of `speeds`."""
    return rotors.max_thrust * speeds**2


def advance_speeds(
    rotors: Rotors,
    speeds: jax.Array,
    wanted: jax.Array,
    timestep: float,
    lag: jax.Array | float = 1.0,
    voltage: jax.Array | float = 0.0,
) -> jax.Array:
    """Speeds [A, 4] after `timestep` s of first-order lag towards those of `wanted` [A, 4] N.

    The exact solution of w' = (goal - w) / t for a goal that is held. `lag` [A, 1]: the drawn lag
    over the nominal. `voltage` [A, 1] in V: of the battery at rest; under load it bounds the goal.
    """
    goal = speeds_of(rotors, wanted)
    if not (isinstance(voltage, float) and voltage == 0.0):
        load = jnp.mean(speeds**3, axis=-1, keepdims=True)  # power goes with the cube of the speed
        loaded = voltage - rotors.battery_drop * load
        goal = jnp.minimum(goal, jnp.maximum(loaded, 0.0) / rotors.full_voltage)
    share = lambda constant: 1.0 - jnp.exp(-timestep / (lag * constant))
    up = share(rotors.lag_up)
    down = up if rotors.lag_up == rotors.lag_down else share(rotors.lag_down)
    return speeds + jnp.where(goal > speeds, up, down) * (goal - speeds)


def hover_speeds(plant: Plant) -> jax.Array:
    """Speeds [A, 4] at which the four thrusts are the weight; at most those of full thrust."""
    level = mix(plant.rotors, plant.weight, jnp.zeros((*plant.weight.shape, 3)))
    return speeds_of(plant.rotors, jnp.minimum(level, plant.rotors.max_thrust))


def _between(rotors: Rotors, number: jax.Array) -> jax.Array:
    """A thrust in N: the least at -1, the most at 1."""
    return rotors.min_thrust + (rotors.max_thrust - rotors.min_thrust) * (number + 1.0) / 2.0


def _moments(rotors: Rotors) -> np.ndarray:
    """[4, 3] m: moments about x, y, z for each newton of each rotor."""
    if rotors.layout is not None:
        return np.array(rotors.layout, np.float32)
    return SIGNS * _arms(rotors)


def _shares(rotors: Rotors) -> np.ndarray:
    """[4, 4]: what each rotor gives for a thrust and a moment about x, y, z: the inverse of all."""
    if rotors.layout is not None:
        given = np.c_[np.ones(4), np.array(rotors.layout, float)].T
        return np.linalg.inv(given).astype(np.float32)
    return np.c_[np.full(4, 0.25, np.float32), SIGNS / (4.0 * _arms(rotors))]


def _arms(rotors: Rotors) -> np.ndarray:
    """[3] m: lever about x, about y, and torque per thrust."""
    return np.array([rotors.arm_y, rotors.arm_x, rotors.torque_ratio], np.float32)
