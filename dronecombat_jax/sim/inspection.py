"""How a drone's file is flown, in words: `dronecombat doctor --mjcf FILE`.

What does not live here: the flights themselves (`side_by_side`), what is refused (`written`).
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.sim.flown import ALIGNED, DRONES, Body
from dronecombat_jax.sim.fluid import box
from dronecombat_jax.sim.mjcf_rotors import rotors_in
from dronecombat_jax.sim.scene import load_scene
from dronecombat_jax.sim.side_by_side import Difference, differences
from dronecombat_jax.sim.source import Written, read_written
from dronecombat_jax.sim.written import Drone, name_of

# C MuJoCo moves a body's origin. Where that lies c off the centre of mass, its own error of a time
# step is of the order of c.
POSITION, PER_CENTRE = 0.01, 1.0  # m, and m for each m of c
RATE = 0.05  # rad/s
SLUGGISH = 30.0  # rad/s^2; Isaac's Crazyflie turns with 282 to 471
_NAMED = 4


class Inspection(NamedTuple):
    """What to say about a file, and whether the game flies it as C MuJoCo does."""

    lines: list[tuple[str, str]]  # a word, and what there is to say of it
    agrees: bool


def inspect(sim: SimConfig) -> Inspection:
    """Read and fly the scene of `sim`. Raises UserError, one line, where it cannot be flown."""
    written = read_written(sim)
    lines = list(_described(sim, written))
    agrees = True
    gaps = differences(sim, load_scene(sim), written)
    for name, drone, difference in zip(DRONES, written.drones, gaps, strict=True):
        fine, text = _judged(drone, difference)
        agrees = agrees and fine
        lines.append(("side by side", f"{name}, {text}"))
    return Inspection(lines, agrees)


def _judged(drone: Drone, difference: Difference) -> tuple[bool, str]:
    limit = POSITION + PER_CENTRE * float(np.linalg.norm(drone.centre))
    fine = difference.position < limit and difference.rate < RATE
    text = (
        f"{difference.flown:.1f} m in one second: {difference.position:.1e} m and {difference.rate:.1e} rad/s "
        "from C MuJoCo's `implicit`"
    )
    return fine, text if fine else f"{text}; at most {limit:.2g} m and {RATE:g} rad/s are right"


def _described(sim: SimConfig, written: Written) -> Iterator[tuple[str, str]]:
    flown = written.flown
    same = flown.bodies[0] == flown.bodies[1]
    described = f"one drone, body {written.own_name}, for defender and attacker"
    yield "file", f"{written.path}: {'a whole scene' if written.whole else described}"
    for name, drone in zip(DRONES, written.drones, strict=True):
        if same and name != DRONES[0]:
            continue
        for word, text in _of_drone(sim, drone, flown.gravity):
            yield word, text if same else f"{name}: {text}"
    if flown.in_fluid:
        wind = f", wind {_spelt(flown.wind)} m/s" if any(flown.wind) else ""
        fluid = f"density {flown.density:g} kg/m^3, viscosity {flown.viscosity:g} Pa s{wind}"
        yield "fluid", f"{fluid}; drag of MuJoCo's inertia box, {_spelt(box(flown.bodies[0]))} m"
    else:
        yield "fluid", "none"
    if not written.whole:
        yield "rotors", _rotors(written)
    yield "not used", "; ".join(_unused(written))


def _rotors(written: Written) -> str:
    """What the file's actuators say of rotors, for an actuation other than the wrench."""
    rotors = rotors_in(written.model, written.drones[0])
    if not rotors:
        return "none: four alike actuators along body z would be; a TOML may say them (sim.body)"
    lag = f"lag {rotors['lag_up']:g} s" if "lag_up" in rotors else "no lag: a TOML must say lag_up"
    thrust = f"{rotors['min_thrust']:g} to {rotors['max_thrust']:g} N each"
    return f"four, {thrust}, {rotors['torque_ratio']:g} m torque per thrust, {lag}"


def _of_drone(sim: SimConfig, drone: Drone, gravity: float) -> Iterator[tuple[str, str]]:
    body, weight = drone.body, drone.body.mass * gravity
    yield "mass", f"{body.mass:.6g} kg, weight {weight:.4g} N in a gravity of {gravity:.6g} m/s^2"
    yield "inertia", _inertia(body)
    if np.abs(drone.centre).max() > 1e-9:
        place = _spelt(drone.centre)
        yield "position", f"of its centre of mass, {place} m from the body's origin"
    ratio, moment = sim.thrust_to_weight, sim.moment_scale
    yield "thrust", f"0 to {ratio * weight:.4g} N along body z (sim.thrust_to_weight {ratio:g})"
    turns = moment / np.diag(body.tensor)
    hint = "; a larger sim.moment_scale turns it faster" if turns.max() < SLUGGISH else ""
    axes = f"up to {moment:g} N m about the body's axes (sim.moment_scale)"
    yield "moments", f"{axes}: {_spelt(turns)} rad/s^2{hint}"


def _inertia(body: Body) -> str:
    tensor = body.tensor
    moments = f"{_spelt(np.diag(tensor))} kg m^2 about the body's axes"
    if body.axes == ALIGNED:
        return moments
    return f"{moments}, products xy, xz, yz {_spelt((tensor[0, 1], tensor[0, 2], tensor[1, 2]))}"


def _unused(written: Written) -> Iterator[str]:
    """What the file has and the game leaves out."""
    yield "time step and integrator (the game's)"
    model: Any = written.model
    if np.any(model.geom_contype | model.geom_conaffinity):
        yield "contacts (the game has none)"
    if written.whole:
        return
    if names := [name_of(model, "actuator", index) for index in range(model.nactuator)]:
        more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        listed = ", ".join(names[:_NAMED])
        yield f"actuators {listed}{more} (thrust and moments are the game's)"
    for word, count in (("sensors", model.nsensor), ("keyframes", model.nkey)):
        if count:
            yield f"{count} {word}"
    if np.any(model.geom_bodyid == 0) or model.nmocap:
        yield "the world around the drone (the arena is the package's)"


def _spelt(numbers: Any) -> str:
    rounded = np.round(np.asarray(numbers), 15) + 0.0
    return "(" + ", ".join(f"{number:.4g}" for number in rounded) + ")"
