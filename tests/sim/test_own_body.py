"""Bodies by TOML, and rotors in an MJCF: the numbers that are flown, and what is refused."""

from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from drones import BIG, SMALL, write
from own_bodies import write_body

from dronecombat_jax.combat.fingerprint import environment
from dronecombat_jax.config.fields import Config, SimConfig
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.sim.actuation import collect, hover_speeds, mix, plant_of, speeds_of
from dronecombat_jax.sim.bodies import rigid_body, rotors_of
from dronecombat_jax.sim.craft import build_craft_step
from dronecombat_jax.sim.flown import package_scene
from dronecombat_jax.sim.rotors import ROTORS
from dronecombat_jax.sim.scene import load_scene
from dronecombat_jax.sim.source import read_written
from dronecombat_jax.types import Craft

# A T: two rotors in front, wide; two behind, narrow; off the corners of any rectangle.
TEE = {
    "rotor_positions": "[[0.05, -0.06], [-0.03, -0.02], [-0.03, 0.02], [0.05, 0.06]]",
    "rotor_directions": "[-1, 1, -1, 1]",
}
WITH_MJCF = {"mass": "", "inertia": ""}  # the MJCF says them
LAG_ALONE = {
    **WITH_MJCF,
    **dict.fromkeys(("rotor_positions", "rotor_directions", "min_thrust", "max_thrust", "torque_ratio"), ""),
}  # fmt: skip


def sim_of(body: object, **more: object) -> SimConfig:
    return replace(SimConfig(), body=str(body), **more)  # pyright: ignore


def steps(sim: SimConfig, actions: np.ndarray) -> list[np.ndarray]:
    """qpos, qvel and speeds after each of `actions` [T, 4], the same for both drones."""
    scene = load_scene(sim)
    fly, craft = build_craft_step(sim, scene), Craft(speeds=hover_speeds(plant_of(sim, scene)))
    pose = jnp.asarray([0.0, 0, 0, 1, 0, 0, 0, 0, 5, 0, 1, 0, 0, 0])

    def advance(state, action):
        state = fly(state[0], state[1], state[2], jnp.int32(0), jnp.stack([action, action]))
        return state, (state[0], state[1], state[2].speeds)

    scan = jax.jit(lambda start, actions: jax.lax.scan(advance, start, actions)[1])
    start = pose, jnp.zeros(12), craft
    return [np.asarray(x) for x in scan(start, jnp.asarray(actions, jnp.float32))]


@pytest.mark.parametrize("body", ROTORS)
def test_a_body_of_the_package_written_out_is_that_body(tmp_path: Path, body: str):
    own = sim_of(write_body(tmp_path, body=body))
    assert rotors_of(own) == (ROTORS[body], "")
    assert rigid_body(own.body) == package_scene(body).bodies[0]
    scene = load_scene(own)
    assert scene.flown == package_scene(body) and scene.rotors == ROTORS[body]


@pytest.mark.long
def test_it_flies_with_the_same_numbers_and_is_the_same_game(tmp_path: Path):
    how = {"actuation": "ctbr", "drag": True, "battery": 3.6}
    named, own = sim_of("firmware", **how), sim_of(write_body(tmp_path), **how)
    actions = np.random.default_rng(0).uniform(-1, 1, (4, 4))
    for ours, theirs in zip(steps(own, actions), steps(named, actions), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    isaac = sim_of(write_body(tmp_path, "isaac.toml", body="isaac"), **how)
    assert environment(Config(sim=isaac)) == environment(Config(sim=sim_of("isaac", **how)))
    met = environment(Config(sim=own))
    assert met["sim.body"] == "isaac" and met["scene.attacker.mass"] == 0.029
    assert met["rotors.lag_up"] == 0.0691 and "rotors.layout" not in met


def test_rotors_anywhere_are_mixed_by_places_and_senses(tmp_path: Path):
    """r x F and the torque, by hand; the mixer is its inverse; at hover nothing turns."""
    sim = sim_of(write_body(tmp_path, **TEE), actuation="rotors")
    scene = load_scene(sim)
    rotors = scene.rotors
    assert rotors is not None and rotors.layout is not None
    thrusts = np.random.default_rng(1).uniform(0.02, 0.1, (5, 4))
    places = np.array([[0.05, -0.06], [-0.03, -0.02], [-0.03, 0.02], [0.05, 0.06]])
    sense = np.array([-1, 1, -1, 1]) * rotors.torque_ratio
    moment = np.stack([thrusts @ places[:, 1], -thrusts @ places[:, 0], thrusts @ sense], axis=1)
    total, given = collect(rotors, jnp.asarray(thrusts, jnp.float32))
    np.testing.assert_allclose(total, thrusts.sum(axis=1), rtol=1e-6)
    np.testing.assert_allclose(given, moment, atol=1e-9)
    np.testing.assert_allclose(mix(rotors, total, given), thrusts, rtol=1e-4)
    level = rotors.max_thrust * np.asarray(hover_speeds(plant_of(sim, scene)), float)[0] ** 2
    np.testing.assert_allclose(level.sum(), scene.weight[0], rtol=1e-5)
    np.testing.assert_allclose(level @ places, 0.0, atol=1e-8)
    assert level[0] < level[1]  # those behind are nearer and carry more
    assert environment(Config(sim=sim))["rotors.layout"][0][0] == -0.06


@pytest.mark.parametrize(
    ("changes", "how", "message"),
    [
        ({"lag_up": "", "torque_ratio": ""}, {"actuation": "ctbr"}, "says no torque_ratio, lag_up; write them"),
        ({"lag_up": ""}, {"drag": True}, "sim.drag = true: "),
        ({"inertia": ""}, {}, "no inertia: a body has both"),
        ({"full_voltage": ""}, {"actuation": "rotors", "battery": 3.7}, "sim.battery = 3.7: "),
        ({"rotor_positions": "[[1, 1], [1, 1], [1, 1], [1, 1]]"}, {}, "cannot turn it about every axis"),
        ({"mass": "-1"}, {}, ":1: mass = -1: must be"),
    ],
)  # fmt: skip
def test_what_a_flight_needs_and_nothing_says(tmp_path: Path, changes, how, message):
    with pytest.raises(UserError) as raised:
        load_scene(sim_of(write_body(tmp_path, **changes), **how))
    error = raised.value
    assert message in error.message and error.exit_code == EXIT_CONFIG
    assert error.message.startswith("sim.") and "\n" not in error.message
    if "lag_up" in changes:  # the ideal wrench needs no rotors
        assert load_scene(sim_of(write_body(tmp_path, **changes))).rotors is None


def test_rotors_are_read_out_of_an_mjcf(tmp_path: Path):
    """Four motors at sites; moments about the centre of mass, from the front right, clockwise."""
    drone, body = write(tmp_path, BIG), write_body(tmp_path, **LAG_ALONE)
    scene = load_scene(sim_of(body, mjcf=str(drone), actuation="rotors"))
    rotors, centre = scene.rotors, read_written(SimConfig(mjcf=str(drone))).drones[0].centre
    assert rotors is not None and rotors.layout is not None
    places = np.array([[0.14, -0.18], [-0.14, -0.18], [-0.14, 0.18], [0.14, 0.18]]) - centre[:2]
    by_hand = np.c_[places[:, 1], -places[:, 0], [0.02, -0.02, 0.02, -0.02]]
    np.testing.assert_allclose(rotors.layout, by_hand, atol=1e-12)
    assert (rotors.min_thrust, rotors.max_thrust) == (0.0, 13.0)
    assert rotors.torque_ratio == pytest.approx(0.02) and rotors.lag_down == 0.1137
    assert load_scene(SimConfig(mjcf=str(drone))).rotors is None  # no lag in the file
    lagging = (
        '<motor ctrlrange="0 13"/>',
        '<general ctrlrange="0 13" dyntype="filter" dynprm="0.05"/>',
    )
    text = BIG.replace("<motor class", "<general class").replace(*lagging)
    own = load_scene(SimConfig(mjcf=str(write(tmp_path, text)), actuation="mixed")).rotors
    assert own is not None and own.lag_up == own.lag_down == 0.05


@pytest.mark.long
def test_an_mjcf_with_rotors_flies_as_in_c_mujoco(tmp_path: Path):
    """Its own motors, at the thrusts that its rotors give at every substep; half a second."""
    drone, body = write(tmp_path, BIG, ("density=\"1.225\" viscosity=\"1.8e-5\"", "")), write_body(tmp_path, **LAG_ALONE)  # fmt: skip
    sim = sim_of(body, mjcf=str(drone), actuation="rotors", timestep=0.001, substeps=10)
    actions = np.random.default_rng(2).uniform(-0.7, -0.3, (50, 4))
    qpos, qvel, _ = steps(sim, actions)
    scene, written = load_scene(sim), read_written(sim)
    rotors, model, own = scene.rotors, written.model, written.drones[0]
    assert rotors is not None
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    data = mujoco.MjData(model)
    data.qpos[:] = [*-own.centre, 1, 0, 0, 0]
    speeds = np.asarray(hover_speeds(plant_of(sim, scene)), float)[0]
    motors = [3, 0, 1, 2]  # of the file: front right first
    for t, action in enumerate(actions):
        goal = np.sqrt(13.0 * (action + 1) / 2 / 13.0)
        for _ in range(sim.substeps):
            lag = np.where(goal > speeds, 0.0691, 0.1137)
            speeds = goal + (speeds - goal) * np.exp(-sim.timestep / lag)
            data.ctrl[motors] = 13.0 * speeds**2
            mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        turn = data.xmat[own.root].reshape(3, 3)
        place = data.xpos[own.root] + turn @ own.centre
        np.testing.assert_allclose(qpos[t, :3], place, atol=5e-3)
        np.testing.assert_allclose(qvel[t, 3:6], data.qvel[3:6], atol=5e-3)
    assert np.linalg.norm(qvel[-1, 3:6]) > 0.3


def test_what_an_mjcf_and_a_toml_say_together(tmp_path: Path):
    small = str(write(tmp_path, SMALL))
    with pytest.raises(UserError, match="says no rotor_positions, min_thrust"):
        load_scene(SimConfig(mjcf=small, actuation="rotors"))
    whole = sim_of(write_body(tmp_path), mjcf=small)
    with pytest.raises(UserError, match=r"mass, inertia: with sim\.mjcf it comes out of that file"):
        load_scene(whole)
    body = write_body(tmp_path, **WITH_MJCF)
    scene = load_scene(sim_of(body, mjcf=small, actuation="ctbr", drag=True))
    assert scene.rotors == ROTORS["firmware"] and scene.mass[0] == 0.027
    speeds = speeds_of(ROTORS["firmware"], jnp.full((2, 4), 0.027 * 9.81 / 4))
    sim = sim_of(body, mjcf=small, actuation="ctbr")
    np.testing.assert_allclose(hover_speeds(plant_of(sim, scene)), speeds, rtol=1e-5)
    with pytest.raises(UserError, match="along the body's axes"):
        load_scene(
            sim_of(write_body(tmp_path, **LAG_ALONE), mjcf=str(write(tmp_path, BIG)), drag=True)
        )
