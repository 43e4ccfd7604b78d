"""The autopilot of the scripted pilots: from a wanted acceleration to the game's wrench.

In here: the geometric attitude controller and the limits of thrust and altitude. Not in here: where
to fly (`scripted`).
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from dronecombat_jax.config.fields import Config
from dronecombat_jax.sim.flight import principal_axes
from dronecombat_jax.sim.inverse import Ask, asking, full_thrust
from dronecombat_jax.sim.rotation import rotate_inverse
from dronecombat_jax.sim.scene import Scene

# Closed-loop pole of the attitude per control step: 0 is deadbeat, at 1 nothing happens.
POLE = 0.4
# The same where rotors lag: slower, as moments come late and are small.
POLE_WITH_ROTORS = 0.75
# The thrust keeps at least this much lift, over gravity: with less, a drone has to roll over before
# it can brake.
MIN_LIFT = 0.15
# A descent never gets faster than this braking can stop at this margin above the crash altitude.
FLOOR_BRAKING = 2.5  # m/s^2
FLOOR_MARGIN = 0.25  # m

VELOCITY_GAIN = 5.0  # 1/s, well below the attitude's bandwidth


class Airframe(NamedTuple):
    """What the controller knows of one drone and of the clock."""

    mass: float  # kg
    gravity: float  # m/s^2
    max_force: float  # full thrust over mass, m/s^2
    momentum: Callable[[jax.Array], jax.Array]  # of rates [..., 3] rad/s, body frame: kg m^2/s
    moment_scale: float  # N m at full deflection
    attitude_gain: float  # 1/s^2
    rate_gain: float  # 1/s
    spin_gain: float  # 1/s, about the body's z axis, whose heading is left alone
    floor: float  # m, the lowest altitude that guidance may ask for
    ask: Ask | None = None  # None: the action is the ideal wrench


def airframe(config: Config, scene: Scene, role: int) -> Airframe:
    """The body of `role`, and attitude gains placed in discrete time.

    A held angular acceleration a moves angle and rate by (b a, h a) in a control step h of n
    substeps of semi-implicit Euler, b = h^2 (n + 1) / 2n. With a = -(k_p angle + k_d rate) both
    poles lie at p if k_p = (1 - p)^2 / h^2 and b k_p + h k_d = 2 (1 - p): stable however small the
    inertia is.
    """
    sim, step = config.sim, config.control_dt
    gravity = float(scene.weight[role] / scene.mass[role])
    ideal = sim.actuation == "wrench"
    gap = 1.0 - (POLE if ideal else POLE_WITH_ROTORS)
    most = sim.thrust_to_weight * gravity
    if not ideal:
        # as a float32, whose square `attainable` may subtract from itself
        most = full_thrust(sim, scene, role) / float(scene.mass[role])
        most = float(np.float32(most))
    inertia = jnp.asarray(scene.inertia[role], jnp.float32)
    inwards, outwards = principal_axes(scene, role)
    return Airframe(
        mass=float(scene.mass[role]),
        gravity=gravity,
        max_force=most,
        momentum=lambda rate: outwards(inertia * inwards(rate)),
        moment_scale=max(sim.moment_scale, 1e-9),
        attitude_gain=gap**2 / step**2,
        rate_gain=(2.0 * gap - gap**2 * (sim.substeps + 1) / (2 * sim.substeps)) / step,
        spin_gain=gap / step,
        floor=config.game.crash_altitude + FLOOR_MARGIN,
        ask=None if ideal else asking(sim, scene, role),
    )


def steer(
    body: Airframe,
    quaternion: jax.Array,
    rate: jax.Array,
    force: jax.Array,
    speeds: jax.Array | None = None,
) -> jax.Array:
    """Action [E, 4] that turns the thrust to `force` [E, 3], a wanted thrust over mass in m/s^2,
    world frame.

    Thrust is the wanted force along the present body z. The moment turns body z towards it on the
    shortest way (Lee, Leok, McClamroch 2010, without a heading) and cancels the gyroscopic torque.
    `quaternion` [E, 4], `rate` [E, 3] rad/s in the body frame; `speeds` [E, 4] of the rotors, where
    they are flown.
    """
    wanted = rotate_inverse(quaternion, force)
    level = jnp.stack([-wanted[:, 1], wanted[:, 0]], axis=-1)  # e_z x wanted
    sine = jnp.linalg.norm(level, axis=-1, keepdims=True)
    anywhere = jnp.asarray([1.0, 0.0])  # upside down, every way is the shortest
    axis = jnp.where(sine > 1e-6, level / jnp.maximum(sine, 1e-6), anywhere)
    angle = jnp.arctan2(sine, wanted[:, 2:])
    tilt = body.attitude_gain * angle * axis - body.rate_gain * rate[:, :2]
    acceleration = jnp.concatenate([tilt, -body.spin_gain * rate[:, 2:]], axis=-1)
    moment = body.momentum(acceleration) + jnp.cross(rate, body.momentum(rate))
    if body.ask is not None and speeds is not None:
        return jnp.clip(body.ask(body.mass * wanted[:, 2], moment, rate, speeds), -1.0, 1.0)
    thrust = 2.0 * wanted[:, 2:] / body.max_force - 1.0
    return jnp.clip(jnp.concatenate([thrust, moment / body.moment_scale], axis=-1), -1.0, 1.0)


def attainable(
    body: Airframe, altitude: jax.Array, climb: jax.Array, acceleration: jax.Array
) -> jax.Array:
    """Thrust over mass [E, 3] nearest to a wanted `acceleration` [E, 3]: altitude first, then the
    way.

    `altitude` [E] m and `climb` [E] m/s: a descent that could not end above the floor is braked.
    """
    safe = -jnp.sqrt(2.0 * FLOOR_BRAKING * jnp.maximum(altitude - body.floor, 0.0))
    vertical = jnp.maximum(acceleration[:, 2], 2.0 * VELOCITY_GAIN * (safe - climb))
    lift = jnp.clip(vertical + body.gravity, MIN_LIFT * body.gravity, body.max_force)
    room = jnp.sqrt(body.max_force**2 - lift**2)
    level = acceleration[:, :2]
    scale = jnp.minimum(1.0, room / jnp.maximum(jnp.linalg.norm(level, axis=-1), 1e-6))
    return jnp.concatenate([level * scale[:, None], lift[:, None]], axis=-1)
