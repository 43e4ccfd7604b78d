"""The package's arena with teams: each side's drone of mjcf/combat.xml as often as the side has
drones.

What lives here: the file, multiplied before MuJoCo reads it, so that names, looks and actuators are
those of the one drone. What does not: the models of it (`scene`).
"""

import copy
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import mujoco

from dronecombat_jax.config.sides import DUEL, Sides, drone_names
from dronecombat_jax.sim import mjcf
from dronecombat_jax.sim.flown import DRONES

_REFERENCES = ("material", "class", "model")  # attributes that name something of the side's
_SPACING = 0.5  # m between team mates where the file places them; a fight's start is elsewhere


def parse_arena(arena: Path, sides: Sides) -> mujoco.MjSpec:
    """The package's scene at `arena` for drones of these `sides`, as it can still be changed.

    A side of several has the drones `defender1`, `defender2`, ..., and all that belongs to one
    (joint, actuators, camera) is named after it.
    """
    if sides == DUEL:
        return mjcf.parse(arena)
    tree = ElementTree.parse(arena)
    world, key = tree.find("worldbody"), tree.find("keyframe/key")
    assert world is not None and key is not None
    bodies = {body.get("name"): body for body in world.findall("body")}
    for body in (bodies[name] for name in DRONES):
        world.remove(body)
    for number, (name, side) in enumerate(zip(drone_names(sides), sides, strict=True)):
        world.append(_renamed(bodies[DRONES[side]], DRONES[side], name, number))
    hover = (key.get("ctrl") or "").split()
    key.set("ctrl", " ".join(hover[: len(hover) // len(DRONES)] * len(sides)))
    with TemporaryDirectory() as folder:
        for file in mjcf.files_of(arena):
            shutil.copy(file, Path(folder, file.name))
        tree.write(Path(folder, arena.name), encoding="unicode")
        return mjcf.parse(Path(folder, arena.name))


def _renamed(body: ElementTree.Element, old: str, new: str, number: int) -> ElementTree.Element:
    """A copy of a drone's body in which every name that begins with `old` begins with `new`."""
    drone = copy.deepcopy(body)
    x, y, z = map(float, (drone.get("pos") or "0 0 0").split())
    drone.set("pos", f"{x + _SPACING * number} {y} {z}")
    for element in drone.iter():
        for attribute, value in element.attrib.items():
            if attribute not in _REFERENCES and value.startswith(old):
                element.set(attribute, new + value[len(old) :])
    return drone
