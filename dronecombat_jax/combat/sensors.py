"""What is observed of a fight: late, seldom, noisy and biased, only what is near, ahead and not
missed, or exactly.

What does not live here: the layout of an observation (`observe`), random numbers (`sim.noise`).
Each side measures both drones with errors of its own; the target is known. Scripted pilots and
rewards know the state itself.
"""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.observe import Observation, layout_of
from dronecombat_jax.config.fields import Config, SensorConfig
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.errors import UserError
from dronecombat_jax.sim import noise
from dronecombat_jax.sim.flight import split
from dronecombat_jax.sim.rotation import multiply, rotate_inverse
from dronecombat_jax.types import SIDES, Craft, Drones, EnvState

View = Callable[[EnvState, jax.Array], jax.Array]  # (fights, what the game shows) -> what is seen

ERRORS = 12  # of a drone: position, attitude, velocity, rate
ALL_ROUND = 360.0  # degrees


def history(sensor: SensorConfig) -> int:
    """How many states have to be remembered; 1: the present one alone."""
    return sensor.latency + sensor.period


def remembered(sensor: SensorConfig, state: EnvState) -> EnvState:
    """The fight with its present state in its memory [K, 26], newest first."""
    if state.craft is None or state.craft.memory is None:
        return state
    now = jnp.concatenate([state.qpos, state.qvel])
    memory = jnp.concatenate([now[None], state.craft.memory[:-1]])
    return state.replace(craft=state.craft.replace(memory=memory))


def first_memory(sensor: SensorConfig, state: EnvState) -> EnvState:
    """A fight about to start, whose past is its start."""
    if state.craft is None or history(sensor) == 1:
        return state
    now = jnp.concatenate([state.qpos, state.qvel])
    memory = jnp.broadcast_to(now, (history(sensor), *now.shape))
    return state.replace(craft=state.craft.replace(memory=memory))


def see(config: Config, observation: Observation, state: EnvState) -> jax.Array:
    """Observation [A, size] of the state, as the sensors of `config` give it."""

    def exact() -> jax.Array:
        drones = split(state.qpos, state.qvel)
        return _look(observation, drones, state.target, _upright(observation, state))

    if state.craft is None or config.sensor == SensorConfig():
        return exact()
    seen = _sensed(config, observation, state, state.craft)
    if config.sensor.side == "both":
        return seen
    sensing = jnp.asarray([SIDES[side] == config.sensor.side for side in config.game.sides])
    return jnp.where(sensing[:, None], seen, exact())


def as_shown(state: EnvState, seen: jax.Array) -> jax.Array:
    """The view of a pilot that sees what the game shows."""
    return seen


def view_of(config: Config, observation: str) -> View:
    """What a pilot is shown where it sees the layout `observation`; "": what the game shows."""
    if not observation:
        return as_shown
    layout = layout_of(observation, config.game)
    look = jax.vmap(lambda state: see(config, layout, state))
    return lambda state, seen: look(state)


def noisy(sensor: SensorConfig) -> bool:
    """Whether a measurement has errors."""
    return any(_deviations(sensor))


def _sensed(config: Config, observation: Observation, state: EnvState, craft: Craft) -> jax.Array:
    """Observation [A, size] of both sides by sensors."""
    sensor = config.sensor
    age = jnp.zeros((), jnp.int32)
    qpos, qvel = state.qpos, state.qvel
    if craft.memory is not None:
        # the newest measurement that has arrived; they are made at multiples of the period
        age = sensor.latency + jnp.mod(state.clock - sensor.latency, sensor.period)
        past = jnp.take(craft.memory, age, axis=0)
        qpos, qvel = past[: qpos.shape[0]], past[qpos.shape[0] :]
    drones, made = split(qpos, qvel), state.clock - age
    seen = _upright(observation, state)
    if limited(sensor):
        visible = in_sight(sensor, drones, craft.word, made)
        seen = visible if seen is None else seen & visible
    if craft.word is None or not noisy(sensor):
        return _look(observation, drones, state.target, seen)
    count = len(drones.position)
    errors = _errors(sensor, craft.word, made, count)
    look = lambda agent: _look(observation, _measured(drones, errors[agent]), state.target, seen)[
        agent
    ]
    return jnp.stack([look(drone) for drone in range(count)])


def in_sight(
    sensor: SensorConfig, drones: Drones, word: jax.Array | None, made: jax.Array
) -> jax.Array:
    """Who sees whom in the measurement `made` at a clock, [A, A] bool by who looks; everybody sees
    itself.

    Another drone is seen up to `range` m away, within `field_of_view` about the observer's body x
    axis, and unless this measurement misses it, which is drawn for each pair from the fight's
    `word`.
    """
    way = drones.position[None] - drones.position[:, None]
    distance = jnp.linalg.norm(way, axis=-1)
    seen = jnp.ones_like(distance, bool)
    if sensor.range:
        seen &= distance <= sensor.range
    if sensor.field_of_view < ALL_ROUND:
        ahead = rotate_inverse(drones.quaternion[:, None], way)[..., 0]
        seen &= ahead >= distance * math.cos(math.radians(sensor.field_of_view) / 2.0)
    if sensor.dropout:
        assert word is not None
        numbers = noise.uniforms(word, made, noise.DROPOUT, distance.size)
        seen &= numbers.reshape(distance.shape) >= sensor.dropout
    return seen | jnp.eye(distance.shape[0], dtype=bool)


def limited(sensor: SensorConfig) -> bool:
    """Whether a drone may be hidden from another."""
    return bool(sensor.range or sensor.dropout) or sensor.field_of_view < ALL_ROUND


def refuse_unlimited(config: Config, observation: Observation) -> None:
    """Raise UserError where a sensor has limits and the observation cannot hide anybody."""
    if limited(config.sensor) and observation.partial is None:
        raise UserError(
            f"game.observation = {one_line(config.game.observation)} cannot hide a drone (its "
            "Observation has no `partial`): sensor.range, field_of_view and dropout must be left out"
        )


def _upright(observation: Observation, state: EnvState) -> jax.Array | None:
    """Who is there to be seen, [A, A] bool; None where the observation does not tell."""
    if not observation.flagged:
        return None
    return ~state.down[None] | jnp.eye(state.down.shape[0], dtype=bool)


def _look(
    observation: Observation, drones: Drones, target: jax.Array, seen: jax.Array | None
) -> jax.Array:
    if seen is None or observation.partial is None:
        return observation.observe(drones, target)
    return observation.partial(drones, target, seen)


def _errors(sensor: SensorConfig, word: jax.Array, made: jax.Array, drones: int) -> jax.Array:
    """Errors [A, A, 12] of the measurements `made` at a clock: by who measures, and of whom."""
    count = drones * drones * ERRORS
    numbers = noise.normals(word, made, noise.NOISE, count)
    if sensor.bias:
        always = noise.normals(word, jnp.zeros((), jnp.int32), noise.BIAS, count)
        numbers = numbers + sensor.bias * always
    scale = jnp.repeat(jnp.asarray(_deviations(sensor)), 3)
    return scale * numbers.reshape(drones, drones, ERRORS)


def _measured(drones: Drones, error: jax.Array) -> Drones:
    """`drones` with `error` [A, 12]; the attitude turns by a small angle about the body's axes."""
    position, angle, velocity, rate = jnp.split(error, 4, axis=-1)
    turn = jnp.concatenate([jnp.ones_like(angle[:, :1]), angle / 2.0], axis=-1)
    turn = turn / jnp.linalg.norm(turn, axis=-1, keepdims=True)
    return Drones(
        drones.position + position,
        multiply(drones.quaternion, turn),
        drones.velocity + velocity,
        drones.rate + rate,
    )


def _deviations(sensor: SensorConfig) -> tuple[float, float, float, float]:
    return (
        sensor.position_noise,
        sensor.attitude_noise,
        sensor.velocity_noise,
        sensor.rate_noise,
    )
