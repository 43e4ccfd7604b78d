"""Bodies by name or by a file of one's own: what `sim.body` says, beside an MJCF or alone.

What does not live here: the package's numbers (`flown`, `rotors`), the check of a file's keys
(`config.body_file`), rotors in an MJCF (`mjcf_rotors`).
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from dronecombat_jax.config import body_file
from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.sim.flown import BODIES, Body
from dronecombat_jax.sim.rotors import PLACES, ROTORS, SENSES, Rotors, flies_rotors

NEUTRAL = "isaac"  # the body that one's own is compared with: where they are alike, it is the same
_RATES, _RATE_GAIN = (10.0, 10.0, 4.0), 20.0  # our choice, as for the package's Crazyflies
_SINGULAR = 1e-6


def named(body: str) -> str:
    """The package's body that `sim.body` names; `NEUTRAL` for a file."""
    return NEUTRAL if body_file.is_file(body) else body


def rigid_body(body: str) -> Body:
    """Mass and inertia of a body of the package, or of a file. UserError that names what lacks."""
    if not body_file.is_file(body):
        return Body(*BODIES[body])
    given = _read(body)
    if missing := body_file.lacking(given, body_file.RIGID):
        raise UserError(f"sim.body: {body}: no {missing}: a body has both")
    return Body(given["mass"], given["inertia"])


def rotors_of(
    sim: SimConfig, of_mjcf: Mapping[str, Any] | None = None
) -> tuple[Rotors | None, str]:
    """The rotors of `sim`, or None and what lacks, in words.

    `of_mjcf`: what the MJCF of `sim` says of them, by key of `config.body_file`, with `layout`
    in place of positions and directions. A file in `sim.body` comes before it. UserError.
    """
    if not sim.mjcf and not body_file.is_file(sim.body):
        return ROTORS[sim.body], ""
    own = _read(sim.body) if body_file.is_file(sim.body) else {}
    if sim.mjcf and (twice := [key for key in body_file.RIGID if key in own]):
        keys = ", ".join(twice)
        raise UserError(f"sim.body: {sim.body}: {keys}: with sim.mjcf it comes out of that file")
    given = {**(of_mjcf or {}), **own}
    needed = [key for key in body_file.ROTORS if key != "rotor_positions" or "layout" not in given]
    if missing := body_file.lacking(given, tuple(needed)):
        return None, missing
    return _rotors(given, _source(sim)), ""


def require_rotors(sim: SimConfig, rotors: Rotors | None, missing: str) -> None:
    """Raise UserError where `sim` flies by numbers that nothing says."""
    setting = "sim.drag = true" if sim.actuation == "wrench" else f"sim.actuation = {sim.actuation}"
    if rotors is None and flies_rotors(sim):
        raise UserError(
            f"{setting}: {_source(sim)} says no {missing}; write them into a TOML file, "
            "--sim.body FILE.toml"
        )
    if rotors is not None and sim.battery and not rotors.full_voltage:
        raise UserError(f"sim.battery = {sim.battery:g}: {_source(sim)} says no full_voltage")


def _source(sim: SimConfig) -> str:
    """The file that speaks of rotors."""
    return sim.body if body_file.is_file(sim.body) else sim.mjcf


def _read(body: str) -> dict[str, Any]:
    try:
        return body_file.read_body(body)
    except UserError as error:
        lines = [f"sim.body: {line}" for line in error.message.splitlines()]
        raise UserError("\n".join(lines)) from None


def _rotors(given: Mapping[str, Any], source: str) -> Rotors:
    layout = given.get("layout")
    if "rotor_positions" in given:
        signs = given.get("rotor_directions", tuple(SENSES))
        layout = [
            (y, -x, sign * given["torque_ratio"])
            for (x, y), sign in zip(given["rotor_positions"], signs, strict=True)
        ]
    moments = np.asarray(layout, float)
    arms = np.abs(moments).mean(axis=0)
    rotors = Rotors(
        arm_x=float(arms[1]),
        arm_y=float(arms[0]),
        min_thrust=given["min_thrust"],
        max_thrust=given["max_thrust"],
        torque_ratio=given["torque_ratio"],
        lag_up=given["lag_up"],
        lag_down=given.get("lag_down", given["lag_up"]),
        drag=given.get("drag", (0.0, 0.0, 0.0)),
        max_rates=given.get("max_rates", _RATES),
        rate_gain=given.get("rate_gain", _RATE_GAIN),
        full_voltage=given.get("full_voltage", 0.0),
        battery_drop=given.get("battery_drop", 0.0),
    )
    places = np.asarray(PLACES) * [rotors.arm_x, rotors.arm_y]
    usual = np.c_[places[:, 1], -places[:, 0], np.asarray(SENSES) * rotors.torque_ratio]
    if np.allclose(moments, usual, rtol=1e-9, atol=1e-12):
        return rotors
    scaled = np.c_[np.ones(4), moments / np.maximum(arms, 1e-12)]
    if abs(np.linalg.det(scaled)) < _SINGULAR:
        raise UserError(
            f"sim.body: {source}: rotors so placed and turning cannot turn it about every axis"
        )
    return replace(rotors, layout=tuple(map(tuple, moments.tolist())))
