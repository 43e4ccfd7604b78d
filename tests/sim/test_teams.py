"""Teams: names, looks and indices of more drones than one a side, and six against C MuJoCo."""

import jax
import mujoco
import numpy as np
import pytest
from drones import BIG, write

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.config.sides import DUEL, drone_names, sides_of, team
from dronecombat_jax.errors import UserError
from dronecombat_jax.sim.flight import build_step, split
from dronecombat_jax.sim.flown import BODIES, DRONES
from dronecombat_jax.sim.scene import Scene, load_scene
from dronecombat_jax.sim.source import find_mjcf_dir

SIX = sides_of(3, 3)
SECOND = 50  # control steps


@pytest.fixture(scope="module")
def six() -> Scene:
    return load_scene(SimConfig(), sides=SIX)


def test_names_and_teams():
    assert drone_names(DUEL) == DRONES
    assert drone_names(sides_of(2, 1)) == ("defender1", "defender2", "attacker")
    assert team(sides_of(2, 3), 0) == slice(0, 2) and team(sides_of(2, 3), 1) == slice(2, 5)


def test_each_drone_has_its_own_body_camera_and_controls_and_its_sides_colour(six: Scene):
    model, names = six.full, drone_names(SIX)
    assert (model.nq, model.nv, model.nu, six.lean.nq) == (42, 36, 24, 42)
    assert [model.body(index).name for index in six.bodies] == list(names)
    for drone, name in enumerate(names):
        assert model.joint(name).qposadr[0] == six.qpos[drone].start == 7 * drone
        assert model.joint(name).dofadr[0] == six.qvel[drone].start == 6 * drone
        thrust, *moments = (model.actuator(column).name for column in six.controls[drone])
        assert thrust == f"{name}_thrust" and moments == [f"{name}_moment_{x}" for x in "xyz"]
        material = model.geom(f"{name}_canopy").matid[0]
        assert model.mat(material).name == DRONES[SIX[drone]]
        assert model.camera(f"{name}_chase").bodyid[0] == six.bodies[drone]
    chased = [model.camera(index).name for index in six.chase_cameras]
    assert chased == ["defender1_chase", "attacker1_chase"]
    np.testing.assert_allclose(model.key_ctrl[0][six.controls[:, 0]], six.weight, rtol=1e-6)


def test_each_place_in_the_file_is_a_different_one(six: Scene):
    places = six.full.qpos0.reshape(6, 7)[:, :3]
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1) + np.eye(6)
    assert apart.min() > 0.3


def test_a_body_of_the_table_flies_on_both_sides():
    scene = load_scene(SimConfig(body="racer"), sides=sides_of(2, 1))
    mass, inertia = BODIES["racer"]
    for index in scene.bodies:
        assert scene.full.body_mass[index] == mass
        np.testing.assert_allclose(scene.full.body_inertia[index], inertia)
    assert scene.lean.body_mass[1:].tolist() == scene.mass.tolist() == [mass] * 3


def test_a_drone_of_ones_own_flies_in_every_place(tmp_path):
    scene = load_scene(SimConfig(mjcf=str(write(tmp_path, BIG))), sides=sides_of(2, 2))
    assert scene.full.nq == 28 and len(set(scene.mass.tolist())) == 1
    assert scene.mass[0] != BODIES["isaac"][0]


def test_a_scene_of_ones_own_holds_one_drone_a_side(tmp_path):
    for file in find_mjcf_dir().iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    sim = SimConfig(mjcf=str(tmp_path / "combat.xml"))
    assert load_scene(sim).full.nq == 14
    with pytest.raises(UserError, match=r"^sim\.mjcf: .*combat\.xml: .*\(not 2 against 1\)$"):
        load_scene(sim, sides=sides_of(2, 1))


def test_six_drones_fly_as_in_c_mujoco_for_a_second(six: Scene):
    random = np.random.default_rng(0)
    qpos = six.full.qpos0.astype(np.float32)
    qvel = random.uniform(-4, 4, 36).astype(np.float32)
    actions = random.uniform(-1, 1, (SECOND, 6, 4)).astype(np.float32)
    actions[..., 1:] *= 0.2
    step = build_step(SimConfig(), six)
    advance = lambda state, action: (step(state[0], state[1], action),) * 2
    path = jax.jit(lambda start, actions: jax.lax.scan(advance, start, actions)[1])
    ours, theirs = (
        split(way[0], way[1])
        for way in (path((qpos, qvel), actions), in_c_mujoco(six, qpos, qvel, actions))
    )
    assert np.abs(theirs.rate).max() > 20.0 and np.abs(theirs.velocity).max() > 5.0
    np.testing.assert_allclose(ours.position, theirs.position, atol=1e-3)
    np.testing.assert_allclose(ours.velocity, theirs.velocity, atol=2e-3)
    np.testing.assert_allclose(ours.rate, theirs.rate, atol=1e-2)


def in_c_mujoco(scene: Scene, qpos: np.ndarray, qvel: np.ndarray, actions: np.ndarray) -> tuple:
    """The same flight through the actuators of the full scene: `qpos [T, 7 A]`, `qvel [T, 6 A]`."""
    data, path = mujoco.MjData(scene.full), []
    data.qpos[:], data.qvel[:] = qpos, qvel
    low, high = scene.full.actuator_ctrlrange[scene.controls].transpose(2, 0, 1)
    for action in actions:
        data.ctrl[scene.controls] = low + (action + 1) / 2 * (high - low)
        mujoco.mj_step(scene.full, data, 2)
        path.append((data.qpos.copy(), data.qvel.copy()))
    return np.array([at for at, _ in path]), np.array([twist for _, twist in path])
