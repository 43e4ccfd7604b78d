"""Rules of the flight that need more than one setting: body, actuation, air, sensors.

What does not live here: the other rules (`preflight`), a body's file itself (`body_file`). Nothing
imports JAX.
"""

from collections.abc import Iterator

from dronecombat_jax.config import body_file
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.problem import Problem
from dronecombat_jax.errors import UserError


def broken(config: Config) -> Iterator[Problem]:
    """All rules of the flight that `config` breaks."""
    own = body_file.is_file(config.sim.body)
    if config.sim.mjcf and config.sim.body != "isaac" and not own:
        yield Problem(
            ("sim.body", "sim.mjcf"),
            f"sim.body = {config.sim.body} is a mass and inertia for the package's drone; "
            "with sim.mjcf both come out of the file: leave sim.body out, or name a TOML of its rotors",
        )
    yield from _actuation(config)


def body_problems(config: Config) -> list[Problem]:
    """One problem for each mistake in the file that `sim.body` names."""
    if not body_file.is_file(config.sim.body):
        return []
    try:
        body_file.read_body(config.sim.body)
    except UserError as error:
        return [Problem(("sim.body",), line) for line in error.message.splitlines()]
    return []


def _actuation(config: Config) -> Iterator[Problem]:
    sim, ideal = config.sim, config.sim.actuation == "wrench"
    if ideal and sim.battery:
        yield Problem(
            ("sim.battery", "sim.actuation"),
            f"sim.battery = {sim.battery:g} needs rotors: sim.actuation must be rotors, mixed or ctbr",
        )
    if sim.battery and sim.body == "racer":
        yield Problem(
            ("sim.battery", "sim.body"),
            f"sim.battery = {sim.battery:g}: no battery is known for sim.body = racer; it must be 0",
        )
    yield from _air_and_sensors(config)


def _air_and_sensors(config: Config) -> Iterator[Problem]:
    sim, sensor = config.sim, config.sensor
    if sensor.bias and not any(
        (
            sensor.position_noise,
            sensor.attitude_noise,
            sensor.velocity_noise,
            sensor.rate_noise,
        )
    ):
        yield Problem(
            ("sensor.bias", "sensor.position_noise"),
            f"sensor.bias = {sensor.bias:g} is a multiple of the noise: one of sensor.position_noise, "
            "attitude_noise, velocity_noise and rate_noise must be above 0",
        )
    if sim.gust_speed and not (sim.drag or sim.mjcf):
        yield Problem(
            ("sim.gust_speed", "sim.drag"),
            f"sim.gust_speed = {sim.gust_speed:g} pushes by drag: sim.drag must be true",
        )
    yield from _nothing_to_vary(config)


def _nothing_to_vary(config: Config) -> Iterator[Problem]:
    """A setting that varies a number needs a simulation in which that number has an effect."""
    sim = config.sim
    ideal = sim.actuation == "wrench"
    absent = {"lag": ideal, "drag": not sim.drag, "battery": not sim.battery}
    for name in (name for name, missing in absent.items() if missing):
        needed = "sim.actuation other than wrench" if name == "lag" else f"sim.{name}"
        for section, neutral in (("randomise", 0.0), ("defender", 1.0), ("attacker", 1.0)):
            value = getattr(getattr(config, section), name)
            if value != neutral:
                yield Problem(
                    (f"{section}.{name}", f"sim.{'actuation' if name == 'lag' else name}"),
                    f"{section}.{name} = {value:g} needs {needed}, or there is nothing to vary",
                )
