"""A drone of one's own as a TOML file, `--sim.body FILE.toml`: its keys, and the check of each.

What does not live here: bodies that come with the package (`sim.flown`, `sim.rotors`), and what is
made of the numbers (`sim.bodies`). Nothing imports JAX or MuJoCo.
"""

import math
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from dronecombat_jax.config.preset_text import lines_of, syntax_error, text_of
from dronecombat_jax.config.schema import shown
from dronecombat_jax.config.suggest import suggestion
from dronecombat_jax.errors import UserError

SUFFIX = ".toml"


class Key(NamedTuple):
    """One key of the file."""

    about: str
    shape: tuple[int, ...]  # (): a number
    low: float  # not allowed itself where `above`
    high: float
    unit: str = ""
    above: bool = True

    @property
    def allowed(self) -> str:
        """What its value may be, to follow the words "must be"."""
        bounds = f"{'above' if self.above else 'from'} {self.low:g}{',' if self.above else ''} "
        bounds += f"{'at most' if self.above else 'to'} {self.high:g} {self.unit}".rstrip()
        if not self.shape:
            return f"a number {bounds}"
        if len(self.shape) == 1:
            return f"a list of {self.shape[0]} numbers {bounds}"
        return f"a list of {self.shape[0]} lists of {self.shape[1]} numbers {bounds}"

    def fits(self, value: Any, shape: tuple[int, ...] | None = None) -> bool:
        """Whether `value` is allowed."""
        shape = self.shape if shape is None else shape
        if shape:
            right = isinstance(value, list) and len(value) == shape[0]
            return right and all(self.fits(item, shape[1:]) for item in value)
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        above = value > self.low if self.above else value >= self.low
        return above and value <= self.high  # false for NaN, and for a whole number beyond a float


KEYS: dict[str, Key] = {
    "mass": Key("the whole drone's", (), 0.0, 1e3, "kg"),
    "inertia": Key("about the axes x (forwards), y (left), z (up)", (3,), 0.0, 1e3, "kg m^2"),
    "rotor_positions": Key(
        "x and y of each rotor from the centre of mass, clockwise as seen from above, "
        "from the front right", (4, 2), -100.0, 100.0, "m", above=False
    ),
    "rotor_directions": Key(
        "sign of each rotor's moment about z: 1 for one that turns clockwise as seen from above "
        "(default: -1, 1, -1, 1)", (4,), -1.0, 1.0, above=False
    ),
    "min_thrust": Key("of a rotor: never less", (), 0.0, 1e4, "N", above=False),
    "max_thrust": Key("of a rotor", (), 0.0, 1e4, "N"),
    "torque_ratio": Key("a rotor's moment about z per newton of thrust", (), 0.0, 10.0, "m"),
    "lag_up": Key("time constant of a rotor's speed, gaining speed", (), 0.0, 10.0, "s"),
    "lag_down": Key("losing speed (default: lag_up)", (), 0.0, 10.0, "s"),
    "drag": Key("linear in the speed, along x, y, z", (3,), 0.0, 1e3, "N s/m", above=False),
    "max_rates": Key(
        "body rates at full command of ctbr (default: 10, 10, 4)", (3,), 0.0, 100.0, "rad/s"
    ),
    "rate_gain": Key("of ctbr's rate loop (default: 20)", (), 0.0, 1e3, "1/s"),
    "full_voltage": Key(
        "at the motor for full thrust; 0: no battery (default)", (), 0.0, 100.0, "V", above=False
    ),
    "battery_drop": Key(
        "lost with all motors at full thrust (default: 0)", (), 0.0, 100.0, "V", above=False
    ),
}  # fmt: skip
RIGID = ("mass", "inertia")
ROTORS = ("rotor_positions", "min_thrust", "max_thrust", "torque_ratio", "lag_up")  # all or none


def is_file(body: str) -> bool:
    """Whether a `sim.body` is a file, not the name of one of the package's."""
    return body.endswith(SUFFIX)


def read_body(path: str) -> dict[str, Any]:
    """The checked values in the file at `path` by key: numbers, and tuples of them.

    UserError with one line for each mistake, which names file, line, key, value and what is allowed.
    """
    text = text_of(Path(path).expanduser())
    try:
        given = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise UserError(syntax_error(path, error)) from None
    lines = lines_of(text)
    place = lambda key: f"{path}:{lines[key]}" if key in lines else path
    faults = [f"{place(key)}: {line}" for key, line in _faults(given)]
    if not faults:
        faults = [f"{place(key)}: {line}" for key, line in _contradictions(given)]
    if faults:
        raise UserError("\n".join(faults))
    return {key: _plain(value) for key, value in given.items()}


def lacking(given: Mapping[str, Any], needed: tuple[str, ...]) -> str:
    """The keys of `needed` that are not there, in words; "" where all are."""
    return ", ".join(key for key in needed if key not in given)


def _faults(given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if not given:
        yield "", f"the file is empty; it may hold {', '.join(KEYS)}"
    for key, value in given.items():
        if key not in KEYS:
            yield key, f"{key}: no such key of a body; {suggestion(key, KEYS)}"
        elif not KEYS[key].fits(value):
            yield key, f"{key} = {shown(value)}: must be {KEYS[key].allowed}"
        elif key == "rotor_directions" and not all(sign in (-1, 1) for sign in value):
            yield key, f"{key} = {shown(value)}: must be a list of 4 of -1 and 1"


def _contradictions(given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Values that are allowed each by itself, and not together."""
    moments = sorted(given.get("inertia", (1.0, 1.0, 1.0)))
    if moments[0] + moments[1] < moments[2]:
        yield (
            "inertia",
            (
                f"inertia = {shown(given['inertia'])}: no body has one above the sum of the two others"
            ),
        )
    low, high = given.get("min_thrust", 0.0), given.get("max_thrust", math.inf)
    if low >= high:
        yield "min_thrust", f"min_thrust = {low:g}: must be below max_thrust = {high:g} N"
    if "mass" in given and 4.0 * high <= 9.81 * given["mass"]:
        yield (
            "max_thrust",
            (
                f"max_thrust = {high:g}: four of it do not lift mass = {given['mass']:g} kg, "
                f"{9.81 * given['mass']:.4g} N"
            ),
        )


def _plain(value: Any) -> Any:
    return tuple(_plain(item) for item in value) if isinstance(value, list) else float(value)
