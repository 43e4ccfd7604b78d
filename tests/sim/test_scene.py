"""The scene: names, masses, indices, the lean model against the full one, and bad MJCF."""

import shutil
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.sim import source
from dronecombat_jax.sim.flown import BODIES, DRONES
from dronecombat_jax.sim.scene import Scene, load_scene
from dronecombat_jax.sim.side_by_side import differences
from dronecombat_jax.sim.source import find_mjcf_dir, read_written


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(SimConfig())


@pytest.fixture
def mjcf(tmp_path: Path) -> Path:
    """A writable copy of the MJCF folder."""
    return Path(shutil.copytree(find_mjcf_dir(), tmp_path / "mjcf"))


def rewrite(file: Path, old: str, new: str) -> Path:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    return file


def test_mass_and_inertia_are_those_of_the_specification(scene: Scene):
    np.testing.assert_array_equal(scene.mass, [0.0282, 0.0282])
    np.testing.assert_array_equal(scene.inertia, [[2.1236e-5, 2.1320e-5, 3.5412e-5]] * 2)
    np.testing.assert_allclose(scene.weight, 0.0282 * 9.81, rtol=1e-12)
    np.testing.assert_array_equal(scene.full.opt.gravity, [0.0, 0.0, -9.81])
    assert scene.full.opt.timestep == scene.lean.opt.timestep == 0.01


@pytest.mark.parametrize("body", BODIES)
def test_both_models_agree_in_mass_inertia_and_layout(body: Any):
    loaded = load_scene(SimConfig(body=body, timestep=0.005))
    for index, name in enumerate(DRONES):
        for model in (loaded.full, loaded.lean):
            np.testing.assert_array_equal(model.body(name).mass, loaded.mass[index])
            np.testing.assert_array_equal(model.body(name).inertia, loaded.inertia[index])
            np.testing.assert_array_equal(model.body(name).iquat, [1, 0, 0, 0])
            assert model.joint(name).qposadr[0] == loaded.qpos[index].start == 7 * index
            assert model.joint(name).dofadr[0] == loaded.qvel[index].start == 6 * index
    assert loaded.full.opt.timestep == loaded.lean.opt.timestep == 0.005
    assert (loaded.mass[0], tuple(loaded.inertia[0])) == BODIES[body]


def test_lean_model_holds_two_bodies_and_nothing_else(scene: Scene):
    lean = scene.lean
    assert (lean.nq, lean.nv, lean.nbody) == (14, 12, 3)
    assert not any(
        (
            lean.ngeom,
            lean.nsite,
            lean.nu,
            lean.ncam,
            lean.nlight,
            lean.nsensor,
            lean.ntex,
            lean.nmat,
            lean.nkey,
            lean.nmocap,
        )
    )
    assert lean.opt.jacobian == mujoco.mjtJacobian.mjJAC_SPARSE
    assert lean.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER


def test_nothing_collides_and_nothing_damps(scene: Scene):
    for model in (scene.full, scene.lean):
        for bit in ("CONTACT", "CONSTRAINT", "EULERDAMP"):
            assert model.opt.disableflags & getattr(mujoco.mjtDisableBit, f"mjDSBL_{bit}")
        assert not np.any(model.dof_damping) and not np.any(model.dof_armature)
    assert not np.any(scene.full.geom_contype) and not np.any(scene.full.geom_conaffinity)


def test_indices_resolve_to_the_named_things(scene: Scene):
    model = scene.full
    assert [model.body(index).name for index in (*scene.bodies, scene.target_body)] == [
        "defender",
        "attacker",
        "target",
    ]
    assert model.body_mocapid[scene.target_body] == scene.target_mocap == 0
    assert [model.cam(index).name for index in (scene.arena_camera, *scene.chase_cameras)] == [
        "arena",
        "defender_chase",
        "attacker_chase",
    ]
    names = [[model.actuator(column).name for column in row] for row in scene.controls]
    assert names[1] == ["attacker_thrust", "attacker_moment_x", "attacker_moment_y", "attacker_moment_z"]


def test_site_motors_are_the_wrench_in_body_axes(scene: Scene):
    """A drone on its side: 0.1 N of thrust pushes along world x, moments turn about body axes."""
    model, data = scene.full, mujoco.MjData(scene.full)
    data.qpos[scene.qpos[1]] = [0, 0, 1, np.sqrt(0.5), 0, np.sqrt(0.5), 0]  # body z along world x
    data.ctrl[scene.controls[1]] = [0.1, 0.001, 0.002, 0.003]
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_actuator[scene.qvel[1]], [0.1, 0, 0, 0.001, 0.002, 0.003], atol=1e-15)
    np.testing.assert_allclose(model.actuator_ctrlrange[scene.controls[0], 1], [1.9 * 0.0282 * 9.81, 0.01, 0.01, 0.01])


def test_hover_keyframe_hovers(scene: Scene):
    data = mujoco.MjData(scene.full)
    mujoco.mj_resetDataKeyframe(scene.full, data, 0)
    mujoco.mj_step(scene.full, data, 100)
    np.testing.assert_allclose(data.qpos[[2, 9]], 1.0, atol=1e-9)


def test_lean_model_flies_like_the_full_one(scene: Scene):
    """Same start, free fall with a slow spin about z, Euler against implicit: the same path."""
    ends = []
    for model in (scene.full, scene.lean):
        data = mujoco.MjData(model)
        data.qpos[:] = mujoco.MjData(scene.full).qpos
        data.qvel[:] = [1, 2, 3, 0, 0, 2, -1, 0, 2, 0, 0, -3]
        mujoco.mj_step(model, data, 50)
        ends.append(data.qpos.copy())
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)


def test_every_shape_of_the_drone_is_massless_and_real_size():
    model = mujoco.MjModel.from_xml_path(str(find_mjcf_dir() / "crazyflie.xml"))
    assert not np.any(model.geom_contype) and not np.any(model.body_mass)
    motors = np.array([model.geom(f"motor_{index}").pos for index in (1, 2, 3, 4)])
    np.testing.assert_allclose(np.linalg.norm(motors[0] - motors[2]), 0.092, atol=1e-3)


def test_folder_is_found_in_a_checkout_and_in_a_wheel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    package = tmp_path / "site" / "dronecombat_jax"
    (package / "sim").mkdir(parents=True)
    monkeypatch.setattr(source, "__file__", str(package / "sim" / "source.py"))
    with pytest.raises(UserError, match=r"combat\.xml: not found"):
        find_mjcf_dir()
    checkout = Path(shutil.copytree(Path(__file__).parents[2] / "mjcf", tmp_path / "site" / "mjcf"))
    assert find_mjcf_dir() == checkout
    wheel = Path(shutil.copytree(checkout, package / "mjcf"))
    assert find_mjcf_dir() == wheel
    assert load_scene(SimConfig()).path == wheel / "combat.xml"


BAD_MJCF = {
    "body": ('body name="attacker"', 'body name="intruder"', ("no body named attacker", "intruder", "defender")),
    "joint": ('freejoint name="attacker"', 'freejoint name="wing"', ("no joint named attacker", "wing")),
    "actuator": ('prefix="attacker_"', 'prefix="a_"', ("no actuator named attacker_thrust", "a_thrust")),
    "camera": ('camera name="arena"', 'camera name="balcony"', ("no camera named arena", "balcony")),
    "target": ('mocap="true"', "", ("body target", "mocap")),
    "malformed": ("</worldbody>", "", ("not well-formed", "line")),
    "zero mass": ('mass="0.0282"', 'mass="0"', ("mass",)),
    "negative mass": ('mass="0.0282"', 'mass="-0.0282"', ("mass",)),
    "not a number": ('mass="0.0282"', 'mass="nan"', ()),
    "impossible inertia": ("3.5412e-5", "9.9e-5", ("inertia",)),
    "off-centre inertial": ('inertial pos="0 0 0"', 'inertial pos="0 0 0.01"', ("origin",)),
    "unknown element": ("<keyframe>", "<keyfame/><keyframe>", ("keyfame",)),
    "absent include": ('file="crazyflie.xml"', 'file="dragonfly.xml"', ("dragonfly.xml", "no such file", "combat.xml")),
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
    hinge = (
        '<body name="gate" pos="0 0 3"><joint name="hinge"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
    )
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
    "turned sign": ('gear="0 0 0 0 1 0"', 'gear="0 0 0 0 -1 0"', ("defender_moment_y", "0.01 N m about y alone")),
    "tiny gear": ('gear="0 0 0 1 0 0"', 'gear="0 0 0 1e-5 0 0"', ("defender_moment_x",)),
    "swapped": ('gear="0 0 1 0 0 0"', 'gear="1 0 0 0 0 0"', ("defender_thrust", "(0.5256, 0, 0) N")),
    "rotor": ('gear="0 0 1 0 0 0"', 'gear="0 0 1 0 0 0.006"', ("defender_thrust", "N m in the body's frame")),
    "off the centre": ('name="centre" size', 'name="centre" pos="0.01 0 0" size', ("defender_thrust",)),
    "tilted": ('name="centre" size', 'name="centre" euler="0 5 0" size', ("defender_thrust",)),
    "weak": ('ctrlrange="0 0.52562"', 'ctrlrange="0 0.52562" forcerange="0 0.3"', ("defender_thrust", "0.3")),
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
    assert scene.full.actuator_ctrlrange[scene.controls[0, 0], 1] == pytest.approx(1.9 * 0.0382 * 9.81)
    rewrite(file, 'pos="0 0 -0.01"', 'pos="0 0 -0.02"')
    with pytest.raises(
        UserError, match=r"body defender: its centre of mass must be the body's origin, not 0 0 -0\.001"
    ):
        load_scene(SimConfig(), mjcf / "combat.xml")


def test_what_acts_on_a_drone_of_a_whole_scene_is_named(mjcf: Path):
    rewrite(mjcf / "combat.xml", '<freejoint name="attacker"/>', '<joint type="free" name="attacker" damping="1e-3"/>')
    with pytest.raises(UserError, match="the free joint of body attacker: damping"):
        load_scene(SimConfig(), mjcf / "combat.xml")


def test_a_whole_scene_may_have_a_fluid_and_two_different_drones(mjcf: Path):
    file = mjcf / "combat.xml"
    rewrite(file, 'gravity="0 0 -9.81"', 'gravity="0 0 -9.81" density="1.2"')
    head, tail = file.read_text().split('<body name="attacker"')
    file.write_text(head + '<body name="attacker"' + tail.replace('mass="0.0282"', 'mass="0.05"'))
    sim = SimConfig(mjcf=str(file))
    scene = load_scene(sim)
    np.testing.assert_array_equal(scene.mass, [0.0282, 0.05])
    found = differences(sim, scene, read_written(sim))
    assert all(one.position < 1e-3 and one.rate < 5e-3 for one in found), found
