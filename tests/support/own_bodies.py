"""Bodies written out as TOML, for tests of `--sim.body FILE.toml`."""

from pathlib import Path

from dronecombat_jax.sim.flown import BODIES
from dronecombat_jax.sim.rotors import PLACES, ROTORS, SENSES


def written_out(body: str) -> dict[str, str]:
    """A body of the package, key by key as TOML spells it."""
    rotors, (mass, inertia) = ROTORS[body], BODIES[body]
    places = [[x * rotors.arm_x, y * rotors.arm_y] for x, y in PLACES]
    values = {
        "mass": mass,
        "inertia": list(inertia),
        "rotor_positions": places,
        "rotor_directions": list(SENSES),
        "min_thrust": rotors.min_thrust,
        "max_thrust": rotors.max_thrust,
        "torque_ratio": rotors.torque_ratio,
        "lag_up": rotors.lag_up,
        "lag_down": rotors.lag_down,
        "drag": list(rotors.drag),
        "max_rates": list(rotors.max_rates),
        "rate_gain": rotors.rate_gain,
        "full_voltage": rotors.full_voltage,
        "battery_drop": rotors.battery_drop,
    }
    return {key: repr(value) for key, value in values.items()}


FIRMWARE = written_out("firmware")


def write_body(
    folder: Path, name: str = "body.toml", body: str = "firmware", **changes: str
) -> Path:
    """The file of a body of the package with `changes`; "" leaves a key out."""
    values = {**written_out(body), **changes}
    file = folder / name
    file.write_text("".join(f"{key} = {value}\n" for key, value in values.items() if value))
    return file
