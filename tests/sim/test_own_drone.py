"""A drone of the user's own: what is read out of its file, how it is flown, and what is refused by its name."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from drones import BIG, SMALL, write

from dronecombat_jax.config import SimConfig
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.sim.scene import load_scene
from dronecombat_jax.sim.side_by_side import differences
from dronecombat_jax.sim.source import read_written

STILL = ('density="1.225" viscosity="1.8e-5"', "")  # a change: no fluid
# Mass and inertia of BIG by hand: rotors of 0.25 kg and half axes (a, a, c), an ellipsoid of 0.325 kg.
ROTORS = np.array([[-0.14, -0.18, 0.05], [-0.14, 0.18, 0.05], [0.14, 0.18, 0.08], [0.14, -0.18, 0.08]])


def ellipsoid(mass: float, *half_axes: float) -> np.ndarray:
    """Inertia m/5 diag(b^2 + c^2, a^2 + c^2, a^2 + b^2)."""
    square = np.square(half_axes)
    return mass / 5.0 * np.diag(square.sum() - square)


def big_by_hand() -> tuple[np.ndarray, np.ndarray]:
    """Centre of mass [3] and inertia [3, 3] about it."""
    masses = np.array([0.25, 0.25, 0.25, 0.25, 0.325])
    places = np.concatenate([ROTORS, [[0.0, 0.0, 0.02]]])
    centre = masses @ places / masses.sum()
    tensor = 4.0 * ellipsoid(0.25, 0.13, 0.13, 0.01) + ellipsoid(0.325, 0.16, 0.04, 0.02)
    for mass, arm in zip(masses, places - centre, strict=True):
        tensor += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return centre, tensor


def test_mass_inertia_gravity_and_fluid_come_out_of_the_file(tmp_path: Path):
    scene = load_scene(SimConfig(mjcf=str(write(tmp_path, SMALL, ("<option ", '<option gravity="0 0 -3.71" ')))))
    np.testing.assert_array_equal(scene.mass, [0.027, 0.027])
    np.testing.assert_array_equal(scene.inertia, [[2.3951e-5, 2.3951e-5, 3.2347e-5]] * 2)
    np.testing.assert_allclose(scene.weight, 0.027 * 3.71, rtol=1e-12)
    assert (scene.flown.density, scene.flown.viscosity) == (1.225, 1.8e-5) and scene.axes is None
    np.testing.assert_array_equal(scene.full.opt.gravity, [0, 0, -3.71])
    np.testing.assert_array_equal(scene.lean.opt.gravity, [0, 0, -3.71])
    assert scene.full.opt.timestep == scene.lean.opt.timestep == 0.01
    np.testing.assert_allclose(scene.full.actuator_ctrlrange[scene.controls[1], 1], [1.9 * 0.10017, 0.01, 0.01, 0.01])


def test_a_drone_made_of_geoms_is_flown_about_its_centre_of_mass(tmp_path: Path):
    sim = SimConfig(mjcf=str(write(tmp_path, BIG)))
    written, (centre, tensor) = read_written(sim), big_by_hand()
    np.testing.assert_allclose(written.drones[0].centre, centre, atol=1e-12)
    np.testing.assert_allclose(written.flown.bodies[1].tensor, tensor, rtol=1e-9, atol=1e-12)
    assert written.flown.bodies[0].mass == pytest.approx(1.325, rel=1e-12)
    scene = load_scene(sim)
    assert scene.axes is not None and abs(tensor[0, 2]) > 1e-3  # or nothing of the axes is tested here
    looks = scene.full.body("defender_own_big")
    np.testing.assert_allclose(looks.pos, -centre, atol=1e-12)
    np.testing.assert_allclose(scene.full.body("attacker").inertia, scene.inertia[1])


def test_bodies_inside_a_body_weigh_too(tmp_path: Path):
    """A battery on top, a counterweight below, a wheel without mass: 0.04 kg, and parallel axes."""
    body = '<body pos="0 0 {}"><inertial pos="0 0 0" mass="{}" diaginertia="{}"/></body>'
    parts = ((0.03, 0.01, "1e-6 2e-6 2e-6"), (-0.1, 0.003, "0 1e-6 1e-6"), (0.5, 0, "1e-6 1e-6 1e-6"))
    inside = "".join(body.format(*part) for part in parts)
    scene = load_scene(SimConfig(mjcf=str(write(tmp_path, SMALL, STILL, ("<freejoint/>", "<freejoint/>" + inside)))))
    arms = 0.01 * 0.03**2 + 0.003 * 0.1**2
    np.testing.assert_allclose(scene.mass, 0.04, rtol=1e-12)
    wanted = [2.3951e-5 + 2e-6 + arms, 2.3951e-5 + 4e-6 + arms, 3.2347e-5 + 4e-6]
    np.testing.assert_allclose(scene.inertia[0], wanted, rtol=1e-9)
    assert scene.axes is None


def test_only_its_looks_are_put_into_the_arena(tmp_path: Path):
    full = load_scene(SimConfig(mjcf=str(write(tmp_path, BIG)))).full
    assert [full.actuator(index).name for index in range(full.nu)][:2] == ["defender_thrust", "defender_moment_x"]
    assert (full.nu, full.nq, full.nsensor) == (8, 14, 0)
    np.testing.assert_allclose(full.body_mass, [0, 0, 1.325, 0, 1.325, 0], rtol=1e-12)
    own = np.flatnonzero(full.geom_bodyid == full.body("attacker_own_big").id)
    assert len(own) == 2 and set(full.geom_group[own]) == {2}  # of group 3 none
    assert not np.any(full.geom_contype) and set(full.geom_group[full.geom_bodyid == full.body("attacker").id]) == {5}


FLIGHTS: dict[str, tuple[str, tuple[tuple[str, str], ...], float]] = {
    "explicit inertia in a fluid": (SMALL, (), 1e-4),
    "still air": (SMALL, (STILL,), 1e-4),
    "thick and windy": (
        SMALL,
        (('density="1.225" viscosity="1.8e-5"', 'density="20" viscosity="0.01" wind="4 -3 1"'),),
        1e-4,
    ),
    "fluid that both flags switch off": (
        SMALL,
        (('viscosity="1.8e-5"/>', 'viscosity="1.8e-5"><flag spring="disable" damper="disable"/></option>'),),
        1e-4,
    ),
    "aligned by the compiler": (SMALL, (("<compiler ", '<compiler alignfree="true" '),), 1e-4),
    # C MuJoCo moves the body's origin, which is 5 cm off: its own error of a time step
    "geoms, off the centre": (BIG, (), 0.04),
    "geoms, aligned by the joint": (BIG, (('<joint type="free"/>', '<freejoint align="true"/>'),), 0.04),
}


@pytest.mark.parametrize("case", FLIGHTS)
def test_it_flies_as_c_mujoco_flies_the_file(case: str, tmp_path: Path):
    """One second, gentle and fast, through one program for both drones."""
    text, changes, metres = FLIGHTS[case]
    sim = SimConfig(mjcf=str(write(tmp_path, text, *changes)))
    found = differences(sim, load_scene(sim), read_written(sim))
    assert all(one.position < metres and one.rate < 2e-3 and one.flown > 0.5 for one in found), found


def test_the_fluid_is_what_makes_the_difference(tmp_path: Path):
    """So that the comparison can fail: flown as if the air were still, the fast drone is metres away."""
    sim = SimConfig(mjcf=str(write(tmp_path)))
    scene = load_scene(sim)
    still = replace(scene, flown=replace(scene.flown, density=0.0, viscosity=0.0))
    gentle, fast = differences(sim, still, read_written(sim))
    assert gentle.position > 0.1 and fast.position > 3.0


def test_the_arena_flies_as_the_file_in_c_mujoco(tmp_path: Path):
    """20 m/s sideways slow down in air, for viewers of the arena too; without the fluid they stay 20."""
    sim = SimConfig(mjcf=str(write(tmp_path)))
    full, own = load_scene(sim).full, read_written(sim).model
    speeds = []
    for model, dof in ((full, 6), (own, 0)):
        data = mujoco.MjData(model)
        data.qvel[dof] = 20.0
        mujoco.mj_step(model, data, 100)
        speeds.append(data.qvel[dof])
    assert speeds[0] == pytest.approx(speeds[1], rel=1e-9) and speeds[0] < 12.0


def test_a_drone_that_starts_turned_and_in_a_frame_hangs_level(tmp_path: Path):
    changes = (
        ('<body name="small" pos="0 0 0.1">', '<frame pos="1 2 3"><body name="small" euler="0 40 0">'),
        ("</body>", "</body></frame>"),
    )
    full = load_scene(SimConfig(mjcf=str(write(tmp_path, SMALL, *changes)))).full
    np.testing.assert_allclose(full.body("defender_own_small").pos, 0.0, atol=1e-12)
    np.testing.assert_allclose(full.body("defender_own_small").quat, [1, 0, 0, 0], atol=1e-12)


BATTERY = (
    '<body name="battery" pos="0 0 0.01">{}<inertial pos="0 0 0" mass="0.005" diaginertia="1e-6 1e-6 1e-6"/></body>'
)
REFUSED: dict[str, tuple[tuple[tuple[str, str], ...], tuple[str, ...]]] = {
    "hinge": ((("<freejoint/>", "<freejoint/>" + BATTERY.format('<joint name="flap"/>')),), ("flap of body battery",)),
    "ball": ((("<freejoint/>", "<freejoint/>" + BATTERY.format('<joint type="ball"/>')),), ("only joint", "battery")),
    "no free joint": ((("<freejoint/>", ""),), ("no free joint", "a whole scene")),
    "second drone": (
        (("<worldbody>", '<worldbody><body name="twin"><freejoint name="f"/><geom size="1"/></body>'),),
        ("f of body twin",),
    ),
    "body with a drag of its own": (
        (("<freejoint/>", "<freejoint/>" + BATTERY.format("")),),
        ("body battery", "fusestatic"),
    ),
    "damping": ((("<freejoint/>", '<joint type="free" damping="1e-3"/>'),), ("free joint of body small", "damping")),
    "armature": ((("<freejoint/>", '<joint type="free" armature="1e-3"/>'),), ("armature",)),
    "friction": ((("<freejoint/>", '<joint type="free" frictionloss="1e-3"/>'),), ("frictionloss",)),
    "spring": ((("<freejoint/>", '<joint type="free" stiffness="1"/>'),), ("stiffness",)),
    "gravity compensation": (
        (('name="small" pos', 'name="small" gravcomp="0.5" pos'),),
        ("body small", "gravcomp"),
    ),
    "ellipsoid": ((('class="seen" type', 'class="seen" name="hull" fluidshape="ellipsoid" type'),), ("geom hull",)),
    "gravity aside": ((("<option ", '<option gravity="1 0 -9.81" '),), ("option gravity 1 0 -9.81",)),
    "gravity upwards": ((("<option ", '<option gravity="0 0 9.81" '),), ("option gravity",)),
    "no gravity": ((('viscosity="1.8e-5"/>', 'viscosity="1.8e-5"><flag gravity="disable"/></option>'),), ("gravity=",)),
    "equality": (
        (("<actuator>", '<equality><connect name="leash" body1="small" anchor="0 0 0"/></equality><actuator>'),),
        ("equality leash",),
    ),
    "tendon": (
        (
            ("<light", '<site name="post"/><light'),
            (
                "<actuator>",
                '<tendon><spatial name="rubber" stiffness="1"><site site="post"/><site site="act"/></spatial></tendon>'
                "<actuator>",
            ),
        ),
        ("tendon rubber",),
    ),
    "sleep": ((('viscosity="1.8e-5"/>', 'viscosity="1.8e-5"><flag sleep="enable"/></option>'),), ("sleep",)),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_what_cannot_be_flown_is_named_in_one_line(fault: str, tmp_path: Path):
    changes, words = REFUSED[fault]
    file = write(tmp_path, SMALL, *changes)
    with pytest.raises(UserError) as raised:
        load_scene(SimConfig(mjcf=str(file)))
    assert raised.value.exit_code == EXIT_CONFIG and "\n" not in raised.value.message
    for word in ("sim.mjcf: ", str(file), *words):
        assert word in raised.value.message


def test_what_no_rule_names_is_noticed_in_the_flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The net below the rules: without the one for gravity compensation, the acceleration gives it away."""
    monkeypatch.setattr("dronecombat_jax.sim.written._body_faults", lambda *_: ())
    file = write(tmp_path, SMALL, ('name="small" pos', 'name="small" gravcomp="0.5" pos'))
    with pytest.raises(UserError, match="body small: something in the file moves it otherwise"):
        load_scene(SimConfig(mjcf=str(file)))


def test_harmless_elements_are_left_out(tmp_path: Path):
    """A string that pulls at nothing, an equality that is off, a body without mass: flown as if they were not there."""
    changes = (
        ("<light", '<site name="post"/><light'),
        ("<freejoint/>", '<freejoint/><body name="antenna"><geom size="0.01" mass="0" contype="0"/></body>'),
        (
            "<actuator>",
            '<tendon><spatial name="thread"><site site="post"/><site site="act"/></spatial></tendon>'
            '<equality><connect active="false" body1="small" anchor="0 0 0"/></equality><actuator>',
        ),
    )
    plain = load_scene(SimConfig(mjcf=str(write(tmp_path))))
    adorned = load_scene(SimConfig(mjcf=str(write(tmp_path, SMALL, *changes, name="adorned.xml"))))
    assert adorned.flown == plain.flown and adorned.full.ntendon == adorned.full.neq == 0


@pytest.mark.parametrize(
    "option", ['settotalmass="3"', 'boundmass="0.5"', 'balanceinertia="true"', 'fusestatic="true"']
)
def test_the_compilers_options_act_once(option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """They are part of the file's mass, and the looks in the arena stay without any."""
    monkeypatch.chdir(tmp_path)  # MuJoCo logs warnings to a file where it stands
    inside = "<freejoint/>" + BATTERY.format("").replace('pos="0 0 0.01"', "")
    changes = (STILL, ("<freejoint/>", inside), ("<compiler ", f"<compiler {option} "))
    file = write(tmp_path, SMALL, *changes)
    written: Any = mujoco.MjModel.from_xml_path(str(file))
    scene = load_scene(SimConfig(mjcf=str(file)))
    assert scene.mass[0] == pytest.approx(written.body_subtreemass[written.body("small").id], rel=1e-12)
    assert scene.full.body_subtreemass[scene.bodies[0]] == pytest.approx(scene.mass[0], rel=1e-12)
