"""The scene: names, masses, indices, the lean model against the full one, and bad MJCF."""

import shutil
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from mjcf_files import rewrite

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.sim import source
from dronecombat_jax.sim.flown import BODIES, DRONES
from dronecombat_jax.sim.scene import Scene, load_scene
from dronecombat_jax.sim.side_by_side import differences
from dronecombat_jax.sim.source import find_mjcf_dir, read_written


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
    assert names[1] == [
        "attacker_thrust",
        "attacker_moment_x",
        "attacker_moment_y",
        "attacker_moment_z",
    ]


def test_site_motors_are_the_wrench_in_body_axes(scene: Scene):
    """A drone on its side: 0.1 N of thrust pushes along world x, moments turn about body axes."""
    model, data = scene.full, mujoco.MjData(scene.full)
    data.qpos[scene.qpos[1]] = [0, 0, 1, np.sqrt(0.5), 0, np.sqrt(0.5), 0]  # body z along world x
    data.ctrl[scene.controls[1]] = [0.1, 0.001, 0.002, 0.003]
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(
        data.qfrc_actuator[scene.qvel[1]], [0.1, 0, 0, 0.001, 0.002, 0.003], atol=1e-15
    )
    np.testing.assert_allclose(
        model.actuator_ctrlrange[scene.controls[0], 1], [1.9 * 0.0282 * 9.81, 0.01, 0.01, 0.01]
    )


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


def test_folder_is_found_in_a_checkout_and_in_a_wheel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
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


@pytest.mark.long
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
