"""A drone of the user's own: what is read out of its file, how it flies, what is refused."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from drones import BIG, SMALL, write

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.sim.scene import Scene, load_scene
from dronecombat_jax.sim.side_by_side import differences
from dronecombat_jax.sim.source import read_written

AIR = 'density="1.225" viscosity="1.8e-5"'
STILL = (AIR, "")  # a change: no fluid
OPTION = 'viscosity="1.8e-5"/>'
FREE = "<freejoint/>"
ROTORS = [[-0.14, -0.18, 0.05], [-0.14, 0.18, 0.05], [0.14, 0.18, 0.08], [0.14, -0.18, 0.08]]  # BIG


def flags(words: str) -> tuple[str, str]:
    """A change: an option flag."""
    return OPTION, f'viscosity="1.8e-5"><flag {words}/></option>'


def own(folder: Path, text: str = SMALL, *changes: tuple[str, str]) -> Scene:
    return load_scene(SimConfig(mjcf=str(write(folder, text, *changes))))


def ellipsoid(mass: float, *half_axes: float) -> np.ndarray:
    """Inertia m/5 diag(b^2 + c^2, a^2 + c^2, a^2 + b^2)."""
    square = np.square(half_axes)
    return mass / 5.0 * np.diag(square.sum() - square)


def big_by_hand() -> tuple[np.ndarray, np.ndarray]:
    """Centre of mass [3] and inertia [3, 3] about it: four rotors and a hull of 0.325 kg."""
    masses = np.array([0.25, 0.25, 0.25, 0.25, 0.325])
    places = np.array([*ROTORS, [0.0, 0.0, 0.02]])
    centre = masses @ places / masses.sum()
    tensor = 4.0 * ellipsoid(0.25, 0.13, 0.13, 0.01) + ellipsoid(0.325, 0.16, 0.04, 0.02)
    for mass, arm in zip(masses, places - centre, strict=True):
        tensor += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return centre, tensor


def test_mass_inertia_gravity_and_fluid_come_out_of_the_file(tmp_path: Path):
    scene = own(tmp_path, SMALL, ("<option ", '<option gravity="0 0 -3.71" '))
    np.testing.assert_array_equal(scene.mass, [0.027, 0.027])
    np.testing.assert_array_equal(scene.inertia, [[2.3951e-5, 2.3951e-5, 3.2347e-5]] * 2)
    np.testing.assert_allclose(scene.weight, 0.027 * 3.71, rtol=1e-12)
    assert (scene.flown.density, scene.flown.viscosity) == (1.225, 1.8e-5) and scene.axes is None
    for model in (scene.full, scene.lean):
        np.testing.assert_array_equal(model.opt.gravity, [0, 0, -3.71])
        assert model.opt.timestep == 0.01
    full_range = scene.full.actuator_ctrlrange[scene.controls[1], 1]
    np.testing.assert_allclose(full_range, [1.9 * 0.10017, 0.01, 0.01, 0.01])


def test_a_drone_made_of_geoms_is_flown_about_its_centre_of_mass(tmp_path: Path):
    sim = SimConfig(mjcf=str(write(tmp_path, BIG)))
    written, (centre, tensor) = read_written(sim), big_by_hand()
    np.testing.assert_allclose(written.drones[0].centre, centre, atol=1e-12)
    np.testing.assert_allclose(written.flown.bodies[1].tensor, tensor, rtol=1e-9, atol=1e-12)
    assert written.flown.bodies[0].mass == pytest.approx(1.325, rel=1e-12)
    scene = load_scene(sim)
    assert scene.axes is not None and abs(tensor[0, 2]) > 1e-3  # or the axes are not tested here
    looks = scene.full.body("defender_own_big")
    np.testing.assert_allclose(looks.pos, -centre, atol=1e-12)
    np.testing.assert_allclose(scene.full.body("attacker").inertia, scene.inertia[1])


def test_bodies_inside_a_body_weigh_too(tmp_path: Path):
    """A battery on top, a counterweight below, a wheel without mass: 0.04 kg, parallel axes."""
    body = '<body pos="0 0 {}"><inertial pos="0 0 0" mass="{}" diaginertia="{}"/></body>'
    battery, counterweight = (0.03, 0.01, "1e-6 2e-6 2e-6"), (-0.1, 0.003, "0 1e-6 1e-6")
    parts = (battery, counterweight, (0.5, 0, "1e-6 1e-6 1e-6"))
    scene = own(tmp_path, SMALL, STILL, (FREE, FREE + "".join(body.format(*p) for p in parts)))
    arms = 0.01 * 0.03**2 + 0.003 * 0.1**2
    np.testing.assert_allclose(scene.mass, 0.04, rtol=1e-12)
    wanted = [2.3951e-5 + 2e-6 + arms, 2.3951e-5 + 4e-6 + arms, 3.2347e-5 + 4e-6]
    np.testing.assert_allclose(scene.inertia[0], wanted, rtol=1e-9)
    assert scene.axes is None


def test_only_its_looks_are_put_into_the_arena(tmp_path: Path):
    full = own(tmp_path, BIG).full
    names = [full.actuator(index).name for index in range(full.nu)]
    assert names[:2] == ["defender_thrust", "defender_moment_x"]
    assert (full.nu, full.nq, full.nsensor) == (8, 14, 0)
    np.testing.assert_allclose(full.body_mass, [0, 0, 1.325, 0, 1.325, 0], rtol=1e-12)
    groups = lambda name: full.geom_group[full.geom_bodyid == full.body(name).id].tolist()
    assert groups("attacker_own_big") == [2, 2]  # of group 3 none
    assert not np.any(full.geom_contype) and set(groups("attacker")) == {5}


WINDY = 'density="20" viscosity="0.01" wind="4 -3 1"'
FLIGHTS: dict[str, tuple[str, tuple[tuple[str, str], ...], float]] = {
    "explicit inertia in a fluid": (SMALL, (), 1e-4),
    "still air": (SMALL, (STILL,), 1e-4),
    "thick and windy": (SMALL, ((AIR, WINDY),), 1e-4),
    "switched off by both flags": (SMALL, (flags('spring="disable" damper="disable"'),), 1e-4),
    "aligned by the compiler": (SMALL, (("<compiler ", '<compiler alignfree="true" '),), 1e-4),
    # C MuJoCo moves the body's origin, which is 5 cm off: its own error of a time step
    "geoms, off the centre": (BIG, (), 0.04),
    "aligned by the joint": (BIG, (('<joint type="free"/>', '<freejoint align="true"/>'),), 0.04),
}


@pytest.mark.parametrize("case", FLIGHTS)
@pytest.mark.long
def test_it_flies_as_c_mujoco_flies_the_file(case: str, tmp_path: Path):
    """One second, gentle and fast, through one program for both drones."""
    text, changes, metres = FLIGHTS[case]
    sim = SimConfig(mjcf=str(write(tmp_path, text, *changes)))
    flights = differences(sim, load_scene(sim), read_written(sim))
    for flight in flights:
        assert flight.position < metres and flight.rate < 2e-3 and flight.flown > 0.5, flights


def test_the_fluid_is_what_makes_the_difference(tmp_path: Path):
    """So that the comparison can fail: flown as if air were still, the fast drone is metres off."""
    sim = SimConfig(mjcf=str(write(tmp_path)))
    scene = load_scene(sim)
    still = replace(scene, flown=replace(scene.flown, density=0.0, viscosity=0.0))
    gentle, fast = differences(sim, still, read_written(sim))
    assert gentle.position > 0.1 and fast.position > 3.0


def test_the_arena_flies_as_the_file_in_c_mujoco(tmp_path: Path):
    """20 m/s sideways slow down in air, for viewers of the arena too; without it they stay 20."""
    sim = SimConfig(mjcf=str(write(tmp_path)))
    speeds = []
    for model, dof in ((load_scene(sim).full, 6), (read_written(sim).model, 0)):
        data = mujoco.MjData(model)
        data.qvel[dof] = 20.0
        mujoco.mj_step(model, data, 100)
        speeds.append(data.qvel[dof])
    assert speeds[0] == pytest.approx(speeds[1], rel=1e-9) and speeds[0] < 12.0


def test_a_drone_that_starts_turned_and_in_a_frame_hangs_level(tmp_path: Path):
    placed = '<frame pos="1 2 3"><body name="small" euler="0 40 0">'
    begun = ('<body name="small" pos="0 0 0.1">', placed), ("</body>", "</body></frame>")
    full = own(tmp_path, SMALL, *begun).full
    np.testing.assert_allclose(full.body("defender_own_small").pos, 0.0, atol=1e-12)
    np.testing.assert_allclose(full.body("defender_own_small").quat, [1, 0, 0, 0], atol=1e-12)


INERTIAL = '<inertial pos="0 0 0" mass="0.005" diaginertia="1e-6 1e-6 1e-6"/>'
BATTERY = f'<body name="battery">{{}}{INERTIAL}</body>'
LEASH = '<equality><connect name="leash" body1="small" anchor="0 0 0"/></equality>'
TWIN = '<body name="twin"><freejoint name="f"/><geom size="1"/></body>'
POST = ("<light", '<site name="post"/><light')
STRING = '<spatial {}><site site="post"/><site site="act"/></spatial>'
RUBBER = "<tendon>" + STRING.format('name="rubber" stiffness="1"') + "</tendon>"


def inside(part: str) -> tuple[str, str]:
    return FREE, FREE + part


def joint(words: str) -> tuple[str, str]:
    return FREE, f'<joint type="free" {words}/>'


def option(words: str) -> tuple[str, str]:
    return "<option ", f"<option {words} "


def before_actuators(part: str) -> tuple[str, str]:
    return "<actuator>", part + "<actuator>"


REFUSED: dict[str, tuple[tuple[tuple[str, str], ...], tuple[str, ...]]] = {
    "hinge": ((inside(BATTERY.format('<joint name="flap"/>')),), ("flap of body battery",)),
    "ball": ((inside(BATTERY.format('<joint type="ball"/>')),), ("only joint", "battery")),
    "no free joint": (((FREE, ""),), ("no free joint", "a whole scene")),
    "second drone": ((("<worldbody>", "<worldbody>" + TWIN),), ("f of body twin",)),
    "part with a drag": ((inside(BATTERY.format("")),), ("body battery", "fusestatic")),
    "damping": ((joint('damping="1e-3"'),), ("free joint of body small", "damping")),
    "armature": ((joint('armature="1e-3"'),), ("armature",)),
    "friction": ((joint('frictionloss="1e-3"'),), ("frictionloss",)),
    "spring": ((joint('stiffness="1"'),), ("stiffness",)),
    "gravcomp": ((('name="small" ', 'name="small" gravcomp="0.5" '),), ("body small: gravcomp",)),
    "ellipsoid": ((('"seen" type', '"seen" name="hull" fluidshape="ellipsoid" type'),), ("hull",)),
    "gravity aside": ((option('gravity="1 0 -9.81"'),), ("option gravity 1 0 -9.81",)),
    "gravity upwards": ((option('gravity="0 0 9.81"'),), ("option gravity",)),
    "no gravity": ((flags('gravity="disable"'),), ("option flag gravity=",)),
    "equality": ((before_actuators(LEASH),), ("equality leash",)),
    "tendon": ((POST, before_actuators(RUBBER)), ("tendon rubber",)),
    "sleep": ((flags('sleep="enable"'),), ("option flag sleep",)),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_what_cannot_be_flown_is_named_in_one_line(fault: str, tmp_path: Path):
    changes, words = REFUSED[fault]
    with pytest.raises(UserError) as raised:
        own(tmp_path, SMALL, *changes)
    assert raised.value.exit_code == EXIT_CONFIG and "\n" not in raised.value.message
    for word in ("sim.mjcf: ", str(tmp_path / "drone.xml"), *words):
        assert word in raised.value.message


def test_what_no_rule_names_is_noticed_in_the_flight(tmp_path: Path, monkeypatch):
    """The net below the rules: without that for `gravcomp`, the acceleration gives it away."""
    monkeypatch.setattr("dronecombat_jax.sim.written._body_faults", lambda *_: ())
    with pytest.raises(UserError, match="body small: something in the file moves it otherwise"):
        own(tmp_path, SMALL, ('name="small" ', 'name="small" gravcomp="0.5" '))


def test_harmless_elements_are_left_out(tmp_path: Path):
    """A string that pulls at nothing, an equality that is off, a body without mass."""
    idle = LEASH.replace("name", 'active="false" name')
    thread = "<tendon>" + STRING.format("") + "</tendon>" + idle
    antenna = '<body><geom size="0.01" mass="0" contype="0"/></body>'
    plain = own(tmp_path)
    adorned = own(tmp_path, SMALL, POST, inside(antenna), before_actuators(thread))
    assert adorned.flown == plain.flown and adorned.full.ntendon == adorned.full.neq == 0


COMPILERS = ('settotalmass="3"', 'boundmass="0.5"', 'balanceinertia="true"', 'fusestatic="true"')


@pytest.mark.parametrize("words", COMPILERS)
def test_the_compilers_options_act_once(words: str, tmp_path: Path, monkeypatch):
    """They are part of the file's mass, and the looks in the arena stay without any."""
    monkeypatch.chdir(tmp_path)  # MuJoCo logs warnings to a file where it stands
    scene = own(
        tmp_path,
        SMALL,
        STILL,
        inside(BATTERY.format("")),
        ("<compiler ", f"<compiler {words} "),
    )
    written: Any = mujoco.MjModel.from_xml_path(str(tmp_path / "drone.xml"))
    mass = written.body_subtreemass[written.body("small").id]
    assert scene.mass[0] == pytest.approx(mass, rel=1e-12)
    assert scene.full.body_subtreemass[scene.bodies[0]] == pytest.approx(mass, rel=1e-12)
