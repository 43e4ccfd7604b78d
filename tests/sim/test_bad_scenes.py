"""MJCF that cannot be flown is refused by the name of the element."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from mjcf_files import rewrite

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.sim.scene import load_scene

BAD_MJCF = {
    "body": (
        'body name="attacker"',
        'body name="intruder"',
        ("no body named attacker", "intruder", "defender"),
    ),
    "joint": (
        'freejoint name="attacker"',
        'freejoint name="wing"',
        ("no joint named attacker", "wing"),
    ),
    "actuator": (
        'prefix="attacker_"',
        'prefix="a_"',
        ("no actuator named attacker_thrust", "a_thrust"),
    ),
    "camera": (
        'camera name="arena"',
        'camera name="balcony"',
        ("no camera named arena", "balcony"),
    ),
    "target": ('mocap="true"', "", ("body target", "mocap")),
    "malformed": ("</worldbody>", "", ("not well-formed", "line")),
    "zero mass": ('mass="0.0282"', 'mass="0"', ("mass",)),
    "negative mass": ('mass="0.0282"', 'mass="-0.0282"', ("mass",)),
    "not a number": ('mass="0.0282"', 'mass="nan"', ()),
    "impossible inertia": ("3.5412e-5", "9.9e-5", ("inertia",)),
    "off-centre inertial": ('inertial pos="0 0 0"', 'inertial pos="0 0 0.01"', ("origin",)),
    "unknown element": ("<keyframe>", "<keyfame/><keyframe>", ("keyfame",)),
    "absent include": (
        'file="crazyflie.xml"',
        'file="dragonfly.xml"',
        ("dragonfly.xml", "no such file", "combat.xml"),
    ),
    "outside": ('file="crazyflie.xml"', 'file="../../crazyflie.xml"', ("leaves the folder",)),
    "absolute": ('file="crazyflie.xml"', 'file="/etc/passwd"', ("leaves the folder",)),
}


@pytest.mark.parametrize("fault", BAD_MJCF)
def test_bad_mjcf_is_one_clear_line(fault: str, mjcf: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(mjcf)  # MuJoCo logs warnings to a file where it stands
    old, new, words = BAD_MJCF[fault]
    file = rewrite(mjcf / "combat.xml", old, new)
    with pytest.raises(UserError) as raised:
        load_scene(SimConfig(), file)
    message = raised.value.message
    assert raised.value.exit_code == EXIT_CONFIG
    assert "\n" not in message and ".xml" in message
    for word in words:
        assert word in message


def test_absent_file_names_the_files_that_exist(mjcf: Path):
    with pytest.raises(UserError, match=r"dogfight.xml: no such file .*combat.xml, crazyflie.xml"):
        load_scene(SimConfig(), mjcf / "dogfight.xml")


def test_extra_joint_and_swapped_drones_are_refused(mjcf: Path):
    file = mjcf / "combat.xml"
    original = file.read_text()
    hinge = '<body name="gate" pos="0 0 3"><joint name="hinge"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
    file.write_text(original.replace("</worldbody>", hinge + "</worldbody>"))
    with pytest.raises(UserError, match=r"only joints .*hinge"):
        load_scene(SimConfig(), file)
    tree = ElementTree.fromstring(original)
    world = tree.find("worldbody")
    assert world is not None
    defender = next(body for body in world.findall("body") if body.get("name") == "defender")
    world.remove(defender)
    world.append(defender)
    file.write_bytes(ElementTree.tostring(tree))
    with pytest.raises(UserError, match="defender, then attacker"):
        load_scene(SimConfig(), file)


def test_symlink_out_of_the_folder_is_refused(mjcf: Path, tmp_path: Path):
    (mjcf / "crazyflie.xml").rename(tmp_path / "elsewhere.xml")
    (mjcf / "crazyflie.xml").symlink_to(tmp_path / "elsewhere.xml")
    with pytest.raises(UserError, match="leaves the folder"):
        load_scene(SimConfig(), mjcf / "combat.xml")


OTHER_WRENCH = {
    "turned sign": (
        'gear="0 0 0 0 1 0"',
        'gear="0 0 0 0 -1 0"',
        ("defender_moment_y", "0.01 N m about y alone"),
    ),
    "tiny gear": ('gear="0 0 0 1 0 0"', 'gear="0 0 0 1e-5 0 0"', ("defender_moment_x",)),
    "swapped": (
        'gear="0 0 1 0 0 0"',
        'gear="1 0 0 0 0 0"',
        ("defender_thrust", "(0.5256, 0, 0) N"),
    ),
    "rotor": (
        'gear="0 0 1 0 0 0"',
        'gear="0 0 1 0 0 0.006"',
        ("defender_thrust", "N m in the body's frame"),
    ),
    "off the centre": (
        'name="centre" size',
        'name="centre" pos="0.01 0 0" size',
        ("defender_thrust",),
    ),
    "tilted": ('name="centre" size', 'name="centre" euler="0 5 0" size', ("defender_thrust",)),
    "weak": (
        'ctrlrange="0 0.52562"',
        'ctrlrange="0 0.52562" forcerange="0 0.3"',
        ("defender_thrust", "0.3"),
    ),
    "filtered": (
        '<motor name="moment_z" site="centre"',
        '<general dyntype="filter" dynprm="0.1" name="moment_z" site="centre"',
        ("defender_moment_z",),
    ),
    "servo": (
        '<motor name="moment_z" site="centre" gear="0 0 0 0 0 1"',
        '<general biastype="affine" biasprm="0 0 -0.1" name="moment_z" site="centre" gear="0 0 0 0 0 1"',
        ("defender_moment_z", "pushes without a command"),
    ),
    "another": (
        "</actuator>",
        '<motor name="gun" site="centre" gear="1 0 0 0 0 0"/></actuator>',
        ("defender_gun, attacker_gun", "the game applies thrust and moments alone"),
    ),
}


@pytest.mark.parametrize("fault", OTHER_WRENCH)
def test_an_actuator_that_is_not_the_wrench_is_named(fault: str, mjcf: Path):
    """Four rotors under the four expected names are the case "rotor" in each of them."""
    old, new, words = OTHER_WRENCH[fault]
    rewrite(mjcf / "crazyflie.xml", old, new)
    with pytest.raises(UserError) as raised:
        load_scene(SimConfig(), mjcf / "combat.xml")
    assert "\n" not in raised.value.message and "actuator " in raised.value.message
    for word in words:
        assert word in raised.value.message


def test_a_body_inside_a_drone_counts_or_is_refused(mjcf: Path):
    """It used to weigh nothing in thrust and flight of the game, and all in C MuJoCo."""
    pair = "".join(
        f'<body name="battery{z}" pos="0 0 {z}"><inertial pos="0 0 0" mass="0.005" diaginertia="1e-6 1e-6 1e-6"/></body>'
        for z in (-0.01, 0.01)
    )
    file = rewrite(mjcf / "crazyflie.xml", "<worldbody>", "<worldbody>" + pair)
    scene = load_scene(SimConfig(), mjcf / "combat.xml")
    np.testing.assert_allclose(scene.mass, 0.0382, rtol=1e-12)
    np.testing.assert_allclose(scene.inertia[1], [2.4236e-5, 2.4320e-5, 3.7412e-5], rtol=1e-9)
    assert scene.full.actuator_ctrlrange[scene.controls[0, 0], 1] == pytest.approx(
        1.9 * 0.0382 * 9.81
    )
    rewrite(file, 'pos="0 0 -0.01"', 'pos="0 0 -0.02"')
    with pytest.raises(
        UserError,
        match=r"body defender: its centre of mass must be the body's origin, not 0 0 -0\.001",
    ):
        load_scene(SimConfig(), mjcf / "combat.xml")


def test_what_acts_on_a_drone_of_a_whole_scene_is_named(mjcf: Path):
    rewrite(
        mjcf / "combat.xml",
        '<freejoint name="attacker"/>',
        '<joint type="free" name="attacker" damping="1e-3"/>',
    )
    with pytest.raises(UserError, match="the free joint of body attacker: damping"):
        load_scene(SimConfig(), mjcf / "combat.xml")
