"""How a drone's file is flown, in words: `dronecombat doctor --mjcf FILE`.

What does not live here: the flights that are compared (`side_by_side`), what is refused (`written`).
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from dronecombat_jax.config import SimConfig
from dronecombat_jax.sim.flown import ALIGNED, DRONES, Body
from dronecombat_jax.sim.fluid import box
from dronecombat_jax.sim.scene import Written, load_scene, read_written
from dronecombat_jax.sim.side_by_side import differences
from dronecombat_jax.sim.written import Drone, name_of

# C MuJoCo moves a body's origin: off the centre of mass by c its own error of one time step is of the order of c.
POSITION, PER_CENTRE = 0.01, 1.0  # m, and m for each m of c
RATE = 0.05  # rad/s
_NAMED = 4


class Inspection(NamedTuple):
    """What there is to say about a file, and whether the game flies it as C MuJoCo does."""

    lines: list[tuple[str, str]]  # a word, and what there is to say of it
    agrees: bool


def inspect(sim: SimConfig) -> Inspection:
    """Read and fly the scene of `sim`. Raises UserError, one line, where it cannot be flown."""
    written = read_written(sim)
    scene = load_scene(sim)
    lines = list(_described(sim, written))
    agrees = True
    for name, drone, found in zip(
        DRONES, written.drones, differences(sim, scene, written), strict=True
    ):
        limit = POSITION + PER_CENTRE * float(np.linalg.norm(drone.centre))
        fine = found.position < limit and found.rate < RATE
        agrees = agrees and fine
        text = (
            f"{name}, {found.flown:.1f} m in one second: {found.position:.1e} m and {found.rate:.1e} rad/s "
            f"from C MuJoCo's `implicit`"
        )
        lines.append(
            (
                "side by side",
                text if fine else f"{text}; at most {limit:.2g} m and {RATE:g} rad/s are right",
            )
        )
    return Inspection(lines, agrees)


def _described(sim: SimConfig, written: Written) -> Iterator[tuple[str, str]]:
    flown, same = written.flown, written.flown.bodies[0] == written.flown.bodies[1]
    kind = (
        "a whole scene"
        if written.whole
        else f"one drone, body {written.own_name}, for defender and attacker"
    )
    yield "file", f"{written.path}: {kind}"
    for name, drone in zip(DRONES, written.drones, strict=True):
        if same and name != DRONES[0]:
            continue
        who = "" if same else f"{name}: "
        for word, text in _of_drone(sim, drone, flown.gravity):
            yield word, who + text
    if flown.in_fluid:
        wind = f", wind {_spelt(flown.wind)} m/s" if any(flown.wind) else ""
        edges = _spelt(box(flown.bodies[0]))
        fluid = f"density {flown.density:g} kg/m^3, viscosity {flown.viscosity:g} Pa s{wind}"
        yield "fluid", f"{fluid}; drag of MuJoCo's inertia box, {edges} m"
    else:
        yield "fluid", "none"
    yield "not used", "; ".join(_unused(written))


def _of_drone(sim: SimConfig, drone: Drone, gravity: float) -> Iterator[tuple[str, str]]:
    body, weight = drone.body, drone.body.mass * gravity
    yield "mass", f"{body.mass:.6g} kg, weight {weight:.4g} N in a gravity of {gravity:.6g} m/s^2"
    yield "inertia", _inertia(body)
    if np.abs(drone.centre).max() > 1e-9:
        yield "position", f"of its centre of mass, {_spelt(drone.centre)} m from the body's origin"
    ratio, moment = sim.thrust_to_weight, sim.moment_scale
    yield "thrust", f"0 to {ratio * weight:.4g} N along body z (sim.thrust_to_weight {ratio:g})"
    turns = moment / np.diag(body.tensor)
    yield (
        "moments",
        f"up to {moment:g} N m about the body's axes (sim.moment_scale): {_spelt(turns)} rad/s^2",
    )


def _inertia(body: Body) -> str:
    moments = f"{_spelt(np.diag(body.tensor))} kg m^2 about the body's axes"
    if body.axes == ALIGNED:
        return moments
    xy, xz, yz = body.tensor[0, 1], body.tensor[0, 2], body.tensor[1, 2]
    return f"{moments}, products xy, xz, yz {_spelt((xy, xz, yz))}"


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
        yield f"actuators {', '.join(names[:_NAMED])}{more} (thrust and moments are the game's)"
    for word, count in (("sensors", model.nsensor), ("keyframes", model.nkey)):
        if count:
            yield f"{count} {word}"
    if np.any(model.geom_bodyid == 0) or model.nmocap:
        yield "the world around the drone (the arena is the package's)"


def _spelt(numbers: Any) -> str:
    return (
        "(" + ", ".join(f"{number + 0.0:.4g}" for number in np.round(np.asarray(numbers), 15)) + ")"
    )
