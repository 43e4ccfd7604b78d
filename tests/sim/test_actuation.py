"""Rotors: the mixer, its limits, the lag, and whole flights against plain double precision and C
MuJoCo.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
import rotor_flights
from rotor_flights import Flight, allocation, at_hover, capped, spun
from scipy.spatial.transform import Rotation

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.sim.actuation import (
    ACTUATIONS,
    advance_speeds,
    collect,
    distribute,
    hover_speeds,
    mix,
    plant_of,
    speeds_of,
)
from dronecombat_jax.sim.craft import build_craft_step
from dronecombat_jax.sim.rotors import ROTORS
from dronecombat_jax.sim.scene import load_scene
from dronecombat_jax.types import Craft

STEPS = 40  # 0.8 s
FLIGHTS = {
    "rotors": SimConfig(body="firmware", actuation="rotors"),
    "rotors with drag and battery": SimConfig(
        body="brushless", actuation="rotors", drag=True, battery=3.6
    ),
    "mixed": SimConfig(body="upgrade", actuation="mixed", moment_scale=0.004),
    "ctbr": SimConfig(body="racer", actuation="ctbr", drag=True),
}


def fly(sim: SimConfig, flights: list[Flight], actions: np.ndarray) -> list[np.ndarray]:
    """Two drones from `flights` by the package: qpos [T, 2, 7], qvel [T, 2, 6], speeds [T, 2, 4]."""
    step = build_craft_step(sim, load_scene(sim))
    pose = [np.r_[f.position, np.roll(f.attitude.as_quat(), 1)] for f in flights]
    twist = [np.r_[f.velocity, f.rate] for f in flights]
    craft = Craft(speeds=jnp.asarray([f.speeds for f in flights], jnp.float32))
    floats = lambda rows: jnp.asarray(np.concatenate(rows), jnp.float32)

    def advance(state, action):
        state = step(state[0], state[1], state[2], jnp.int32(0), action)
        return state, (state[0].reshape(2, 7), state[1].reshape(2, 6), state[2].speeds)

    scan = jax.jit(lambda state, actions: jax.lax.scan(advance, state, actions)[1])
    return [np.asarray(x) for x in scan((floats(pose), floats(twist), craft), jnp.asarray(actions))]


def start_and_actions(sim: SimConfig) -> tuple[list[Flight], np.ndarray]:
    """A gentle and a fast start, and actions [T, 2, 4] near hover, beyond the limits at times."""
    random = np.random.default_rng(1)
    tilted = Rotation.from_rotvec([0.4, -0.3, 0.8])
    fast = {"velocity": np.array([3.0, -2.0, 1.0]), "rate": np.array([2.0, -3.0, 1.0])}
    starts = [at_hover(sim), at_hover(sim, attitude=tilted, **fast)]
    actions = random.uniform(-0.6, 0.6, (STEPS, 2, 4))
    actions[:, :, 0] += 0.3
    actions[::7] *= 3.0
    return starts, actions.astype(np.float32)


@pytest.mark.parametrize("case", FLIGHTS)
@pytest.mark.long
def test_flights_agree_with_double_precision_step_for_step(case: str):
    sim = FLIGHTS[case]
    starts, actions = start_and_actions(sim)
    qpos, qvel, speeds = fly(sim, starts, actions)
    for drone, start in enumerate(starts):
        path = rotor_flights.flown(sim, start, actions[:, drone].astype(float))
        for t, exact in enumerate(path):
            np.testing.assert_allclose(speeds[t, drone], exact.speeds, atol=2e-5)
            np.testing.assert_allclose(qpos[t, drone, :3], exact.position, atol=1e-4)
            np.testing.assert_allclose(qvel[t, drone, :3], exact.velocity, atol=3e-4)
            np.testing.assert_allclose(qvel[t, drone, 3:], exact.rate, atol=5e-3)
        assert np.linalg.norm(path[-1].rate) > 0.5  # it did turn
    assert speeds.max() > speeds.min() + 0.2


@pytest.mark.parametrize("case", ["rotors", "mixed", "ctbr"])
@pytest.mark.long
def test_flights_agree_with_c_mujoco(case: str):
    """The same rotors, and the same rate loop, in front of C MuJoCo's `implicit` integrator."""
    sim = replace(FLIGHTS[case], drag=False)  # C MuJoCo's drag is another
    scene = load_scene(sim)
    starts, actions = start_and_actions(sim)
    qpos, qvel, _ = fly(sim, starts, actions)
    scene.full.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
    data, speeds = mujoco.MjData(scene.full), [start.speeds for start in starts]
    for drone, start in enumerate(starts):
        data.qpos[scene.qpos[drone]] = np.r_[start.position, np.roll(start.attitude.as_quat(), 1)]
        data.qvel[scene.qvel[drone]] = np.r_[start.velocity, start.rate]
    for t in range(STEPS):
        for _ in range(sim.substeps):
            for drone in range(2):
                rate = data.qvel[scene.qvel[drone]][3:].copy()
                now = at_hover(sim, speeds=speeds[drone], rate=rate)
                action = np.clip(actions[t, drone].astype(float), -1, 1)
                speeds[drone] = spun(sim, now, action)
                given = allocation(sim.body) @ (ROTORS[sim.body].max_thrust * speeds[drone] ** 2)
                data.ctrl[scene.controls[drone]] = given
            mujoco.mj_step(scene.full, data)
        for drone in range(2):
            place, twist = data.qpos[scene.qpos[drone]], data.qvel[scene.qvel[drone]]
            np.testing.assert_allclose(qpos[t, drone, :3], place[:3], atol=1e-3)
            np.testing.assert_allclose(qvel[t, drone, :3], twist[:3], atol=2e-3)
            np.testing.assert_allclose(qvel[t, drone, 3:], twist[3:], atol=2e-2)


@pytest.mark.parametrize("body", ROTORS)
def test_mixer_is_the_inverse_of_places_and_senses(body: str):
    random = np.random.default_rng(2)
    thrusts = random.uniform(0, ROTORS[body].max_thrust, (5, 4)).astype(np.float32)
    given = thrusts @ allocation(body).T
    thrust, moment = collect(ROTORS[body], jnp.asarray(thrusts))
    scale = ROTORS[body].max_thrust
    np.testing.assert_allclose(thrust, given[:, 0], rtol=1e-5)
    np.testing.assert_allclose(moment, given[:, 1:], atol=1e-6 * scale)
    np.testing.assert_allclose(mix(ROTORS[body], thrust, moment), thrusts, atol=1e-5 * scale)


def test_limits_are_the_firmwares():
    """Moments come before thrust; a rotor is never under its least."""
    rotors, random = ROTORS["firmware"], np.random.default_rng(3)
    thrust = random.uniform(0, 0.6, 50)
    moment = random.normal(size=(50, 3)) * [2e-3, 2e-3, 1e-3]
    ours = distribute(rotors, jnp.asarray(thrust), jnp.asarray(moment))
    solved = np.linalg.solve(allocation("firmware"), np.c_[thrust, moment].T).T
    np.testing.assert_allclose(ours, [capped("firmware", row) for row in solved], atol=1e-6)
    assert np.asarray(ours).min() == np.float32(rotors.min_thrust)
    np.testing.assert_allclose(np.asarray(ours).max(), rotors.max_thrust, rtol=1e-6)


def test_lag_up_and_down_is_first_order_in_the_speed():
    """After one time constant 1 - 1/e of the way; up in 0.0691 s, down in 0.1137 s."""
    rotors = ROTORS["firmware"]
    low, high = (jnp.full((2, 4), thrust) for thrust in (rotors.min_thrust, rotors.max_thrust))
    slow, fast = speeds_of(rotors, low), speeds_of(rotors, high)
    up = advance_speeds(rotors, slow, high, 0.0691)
    down = advance_speeds(rotors, fast, low, 0.1137)
    np.testing.assert_allclose((up - slow) / (fast - slow), 1 - np.exp(-1), rtol=1e-5)
    np.testing.assert_allclose((fast - down) / (fast - slow), 1 - np.exp(-1), rtol=1e-5)
    halves = advance_speeds(rotors, advance_speeds(rotors, slow, high, 0.02), high, 0.03)
    np.testing.assert_allclose(halves, advance_speeds(rotors, slow, high, 0.05), rtol=1e-5)
    slower = advance_speeds(rotors, slow, high, 0.0691, lag=jnp.full((2, 1), 2.0))
    np.testing.assert_allclose((slower - slow) / (fast - slow), 1 - np.exp(-0.5), rtol=1e-5)


def test_a_battery_bounds_thrust_and_nothing_else():
    """At 3.4 V less 0.7 V under full load, 2.997 V are needed: thrust (2.7 / 2.997)^2."""
    rotors, full = ROTORS["firmware"], jnp.ones((2, 4))
    most = jnp.full((2, 4), rotors.max_thrust)
    settled = full
    for _ in range(200):
        settled = advance_speeds(rotors, settled, most, 0.05, voltage=3.4)
    volts = 3.4 - 0.7 * float(settled[0, 0]) ** 3
    np.testing.assert_allclose(settled, volts / 2.997, rtol=1e-5)
    assert 0.9 < float(settled[0, 0]) < 0.96
    little = jnp.full((2, 4), rotors.max_thrust / 4)
    np.testing.assert_allclose(
        advance_speeds(rotors, full / 2, little, 0.01, voltage=3.4), 0.5, rtol=1e-6
    )
    np.testing.assert_array_equal(advance_speeds(rotors, full, most, 0.01, voltage=4.2), full)


def test_every_choice_has_its_actuation_and_every_body_its_rotors():
    from dronecombat_jax.config.settings import SCHEMA
    from dronecombat_jax.sim.flown import BODIES

    assert tuple(ACTUATIONS) == SCHEMA["sim.actuation"].choices
    assert set(ROTORS) == set(BODIES) == set(SCHEMA["sim.body"].choices)


def test_speeds_at_the_start_carry_the_weight():
    for body in ROTORS:
        sim = SimConfig(body=body, actuation="rotors")
        plant = plant_of(sim, load_scene(replace(sim)))
        thrust = ROTORS[body].max_thrust * np.asarray(hover_speeds(plant), float) ** 2
        np.testing.assert_allclose(thrust.sum(axis=-1), plant.weight, rtol=1e-5)
