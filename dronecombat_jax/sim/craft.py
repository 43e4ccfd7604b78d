"""One control step of drones that are more than ideal rigid bodies: rotors with lag, drag, gusts,
and random numbers for each fight.

What does not live here: the paper's drone (`flight.build_step`), what an action asks of rotors
(`actuation`), the numbers (`rotors`). Commands are scaled by the nominal body, the physics by the
drawn one: a drone heavier than its controller thinks sinks on the command for hover.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp

from dronecombat_jax.config.fields import Config, DroneConfig, SensorConfig, SimConfig
from dronecombat_jax.sim import noise
from dronecombat_jax.sim.actuation import (
    ACTUATIONS,
    advance_speeds,
    collect,
    hover_speeds,
    plant_of,
    thrusts_of,
)
from dronecombat_jax.sim.flight import build_turn, limit_rate, principal_axes, split, wrench
from dronecombat_jax.sim.fluid import Drag, drags
from dronecombat_jax.sim.physics import build_physics
from dronecombat_jax.sim.rotation import body_z, rotate, rotate_inverse
from dronecombat_jax.sim.scene import Scene
from dronecombat_jax.types import Craft, Drawn, Drones

# (qpos [14], qvel [12], craft, clock [], action [A, 4]) -> (qpos, qvel, craft)
CraftStep = Callable[
    [jax.Array, jax.Array, Craft, jax.Array, jax.Array], tuple[jax.Array, jax.Array, Craft]
]
# (action [A, 4], rate [A, 3], craft) -> thrust [A] N, moment [A, 3] N m, craft
Drive = Callable[[jax.Array, jax.Array, Craft], tuple[jax.Array, jax.Array, Craft]]
# (drones, thrust [A], craft) -> force to apply [A, 3] N, world frame
Push = Callable[[Drones, jax.Array, Craft], jax.Array]


def is_ideal(config: Config) -> bool:
    """Whether the drones are rigid bodies under an ideal wrench, seen exactly, and nothing else."""
    sim = config.sim
    alike = config.sensor == SensorConfig() and not (_drawn(config) or _other(config))
    return alike and sim.actuation == "wrench" and not sim.drag and not sim.gust_speed


def num_random(config: Config) -> int:
    """How many uniform numbers `spawn_craft` needs for a fight."""
    return len(config.game.sides) * len(_names()) * _drawn(config) + _hashes(config)


def spawn_craft(config: Config, scene: Scene, numbers: jax.Array) -> Craft | None:
    """The craft at a fight's start, from `numbers` [num_random] in [0, 1); None: `is_ideal`.

    Rotors begin at the nominal speed of hover, the wind at rest; `combat.sensors` adds the memory.
    """
    if is_ideal(config):
        return None
    sim, drones = config.sim, len(config.game.sides)
    size = drones * len(_names())
    drawn = word = None
    if _drawn(config):
        centred = 2.0 * numbers[:size].reshape(len(_names()), drones) - 1.0
        ranges = [getattr(config.randomise, name) for name in _names()]
        drawn = Drawn(*(1.0 + share * row for share, row in zip(ranges, centred, strict=True)))
    if _other(config):
        factors = Drawn(*(_factors(config, name) for name in _names()))
        drawn = factors if drawn is None else jax.tree.map(jnp.multiply, factors, drawn)
    if _hashes(config):
        word = noise.word_of(numbers[-1])
    return Craft(
        speeds=None if sim.actuation == "wrench" else hover_speeds(plant_of(sim, scene)),
        drawn=drawn,
        wind=jnp.zeros(3) if sim.gust_speed else None,
        word=word,
    )


def build_craft_step(sim: SimConfig, scene: Scene) -> CraftStep:
    """Return `step(qpos [14], qvel [12], craft, clock [], action [A, 4]) -> (qpos, qvel, craft)`,
    one control step of one scene.

    The action is clipped to [-1, 1]; vmap over environments is the caller's.
    """
    advance = build_physics(scene)
    drive, push, turn = _driving(sim, scene), _pushing(sim, scene), build_turn(sim, scene)

    def substep(qpos: jax.Array, qvel: jax.Array, craft: Craft, action: jax.Array):
        drones = split(qpos, qvel)
        thrust, moment, craft = drive(action, drones.rate, craft)
        if craft.drawn is not None:
            # I k w' = k (m / k - w x I w): what a scaled inertia does to moments, the rest is alike
            moment = moment / craft.drawn.inertia[:, None]
        torque = turn(drones.rate, moment)
        applied = jnp.concatenate([push(drones, thrust, craft), torque], axis=-1).reshape(-1)
        qpos, qvel = advance(qpos, qvel, applied)
        return qpos, limit_rate(qvel, sim.max_body_rate), craft

    def step(
        qpos: jax.Array, qvel: jax.Array, craft: Craft, clock: jax.Array, action: jax.Array
    ) -> tuple[jax.Array, jax.Array, Craft]:
        action = jnp.clip(action, -1.0, 1.0)
        craft = _gust(sim, craft, clock)
        again = lambda state, _: (substep(state[0], state[1], state[2], action), None)
        state, _ = jax.lax.scan(again, (qpos, qvel, craft), length=sim.substeps, unroll=True)
        return state

    return step


def _driving(sim: SimConfig, scene: Scene) -> Drive:
    """Thrust and moment of the actuation in a substep, with the fight's own thrust factor; the
    rotors move first.
    """
    command = ACTUATIONS[sim.actuation]

    def factor(craft: Craft) -> jax.Array | float:
        return 1.0 if craft.drawn is None else craft.drawn.thrust

    if command is None:
        return _ideal(sim, scene, factor)
    plant = plant_of(sim, scene)

    def by_rotors(action: jax.Array, rate: jax.Array, craft: Craft):
        assert craft.speeds is not None
        wanted = command(plant, action, rate, craft.speeds)
        lag = voltage = None
        if craft.drawn is not None:
            lag, voltage = craft.drawn.lag[:, None], sim.battery * craft.drawn.battery[:, None]
        speeds = advance_speeds(
            plant.rotors,
            craft.speeds,
            wanted,
            sim.timestep,
            1.0 if lag is None else lag,
            sim.battery if voltage is None or not sim.battery else voltage,
        )
        thrust, moment = collect(plant.rotors, thrusts_of(plant.rotors, speeds))
        scale = factor(craft) * jnp.ones_like(thrust)
        return scale * thrust, scale[:, None] * moment, craft.replace(speeds=speeds)

    return by_rotors


def _ideal(sim: SimConfig, scene: Scene, factor: Callable[[Craft], Any]) -> Drive:
    """The wrench of eq. 7 and 8, times the drawn factor."""
    full_thrust = sim.thrust_to_weight * jnp.asarray(scene.weight, jnp.float32)

    def drive(action: jax.Array, rate: jax.Array, craft: Craft):
        thrust, moment = wrench(action, full_thrust, sim.moment_scale)
        scale = factor(craft) * jnp.ones_like(thrust)
        return scale * thrust, scale[:, None] * moment, craft

    return drive


def _pushing(sim: SimConfig, scene: Scene) -> Push:
    """The force to apply, so that MJX, which knows the nominal mass m, accelerates as the drawn one.

    (m' + h d) a = f + d(v) + m' g with the drag d(v), implicit by its slope d; applied is m (a - g).
    """
    mass = jnp.asarray(scene.mass, jnp.float32)[:, None]
    gravity = jnp.asarray([0.0, 0.0, -scene.flown.gravity])
    fluid = drags(scene.flown)[0] if scene.flown.in_fluid else None
    still = jnp.asarray(scene.flown.wind, jnp.float32)
    inwards, outwards = principal_axes(scene)
    own = None
    if sim.drag and scene.rotors is not None:  # with bodies whose principal axes are their own
        own = jnp.broadcast_to(jnp.asarray(scene.rotors.drag), (len(mass), 3))

    def push(drones: Drones, thrust: jax.Array, craft: Craft) -> jax.Array:
        heavy = mass if craft.drawn is None else mass * craft.drawn.mass[:, None]
        if fluid is None and own is None:
            return (mass / heavy * thrust[:, None]) * body_z(drones.quaternion)
        into = lambda vector: inwards(rotate_inverse(drones.quaternion, vector))
        air = still if craft.wind is None else still + craft.wind
        drag, slope = _resistance(own, fluid, craft, len(thrust)).resist(
            into(drones.velocity - air)
        )
        weight = into(jnp.broadcast_to(gravity, drones.velocity.shape))
        force = thrust[:, None] * inwards(jnp.asarray([[0.0, 0.0, 1.0]] * len(thrust)))
        sped = (force + drag + heavy * weight) / (heavy + sim.timestep * slope)
        return rotate(drones.quaternion, outwards(mass * (sped - weight)))

    return push


def _resistance(own: jax.Array | None, fluid: Drag | None, craft: Craft, drones: int) -> Drag:
    """Drag of the fluid of an MJCF, and that of the body `own` [A, 3], along the principal axes."""
    viscous = jnp.zeros((drones, 3)) if fluid is None else fluid.viscous
    quadratic = jnp.zeros((drones, 3)) if fluid is None else fluid.quadratic
    if own is not None:
        viscous = viscous + (own if craft.drawn is None else craft.drawn.drag[:, None] * own)
    return Drag(viscous, quadratic)


def _gust(sim: SimConfig, craft: Craft, clock: jax.Array) -> Craft:
    """The wind of the next control step: an Ornstein-Uhlenbeck process, exact in its steps."""
    if craft.wind is None or craft.word is None:
        return craft
    kept = jnp.exp(-sim.timestep * sim.substeps / sim.gust_time)
    fresh = noise.normals(craft.word, clock, noise.GUSTS, 3)
    return craft.replace(wind=kept * craft.wind + sim.gust_speed * jnp.sqrt(1.0 - kept**2) * fresh)


def _hashes(config: Config) -> bool:
    """Whether something random goes on during a fight: gusts, noise or drop-outs."""
    certain = {"side": "both", "latency": 0, "period": 1, "range": 0.0, "field_of_view": 360.0}
    return config.sim.gust_speed > 0.0 or replace(config.sensor, **certain) != SensorConfig()


def _drawn(config: Config) -> bool:
    return any(getattr(config.randomise, name) for name in _names())


def _other(config: Config) -> bool:
    """Whether a side's drone is another than the nominal one in every fight."""
    return (config.defender, config.attacker) != (DroneConfig(), DroneConfig())


def _factors(config: Config, name: str) -> jax.Array:
    """Each drone's factor [A] of one number: its own value over the nominal one."""
    by_side = getattr(config.defender, name), getattr(config.attacker, name)
    return jnp.asarray([by_side[side] for side in config.game.sides])


def _names() -> list[str]:
    return list(Drawn.__dataclass_fields__)
