"""Scripted pilots, apart from their fights: attitude controller, thrust limits, choice by name."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dronecombat_jax.combat import autopilot, guidance, scripted
from dronecombat_jax.config.fields import Config, SimConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause, EnvState

KEY = jax.random.key(0)
NAMES = [name for guidances in scripted.PILOTS.values() for name in guidances]
STILL = (2 / 1.9 - 1, 0.0, 0.0, 0.0)  # thrust equals weight


@pytest.fixture(scope="module")
def body(arena: SimpleNamespace) -> autopilot.Airframe:
    return autopilot.airframe(arena.combat.config, arena.combat.scene, DEFENDER)


def fly_defender(arena: SimpleNamespace, state: EnvState, steps: int) -> np.ndarray:
    """Position, quaternion, velocity and rate [steps, E, 13] under `hover`; the attacker holds
    still.
    """
    pilot = jax.jit(scripted.build_pilot("hover", arena.combat.config, arena.combat.scene))
    still, path = jnp.tile(jnp.asarray(STILL), (arena.size, 1)), []
    for _ in range(steps):
        state, _ = arena.step(state, jnp.stack([pilot(state, None, KEY), still], axis=1))
        path.append(np.concatenate([state.qpos[:, :7], state.qvel[:, :6]], axis=-1))
    return np.stack(path)


def random_state(seed: int, fights: int) -> EnvState:
    """Anything that can happen, upside down included."""
    random = np.random.default_rng(seed)
    pose = random.normal(size=(fights, 2, 7)) * 2
    pose[..., 2] = random.uniform(0.3, 4.0, size=(fights, 2))
    pose[..., 3:] /= np.linalg.norm(pose[..., 3:], axis=-1, keepdims=True)
    return EnvState(
        qpos=jnp.asarray(pose.reshape(fights, 14), jnp.float32),
        qvel=jnp.asarray(random.normal(size=(fights, 12)) * 8, jnp.float32),
        target=jnp.asarray(random.uniform(-5, 5, size=(fights, 3)), jnp.float32),
        clock=jnp.asarray(random.integers(0, 500, size=fights), jnp.int32),
        down=jnp.zeros((fights, 2), bool),
    )


@pytest.mark.parametrize("timestep, substeps", [(0.01, 2), (0.02, 1), (0.005, 4), (0.002, 10)])
def test_attitude_poles_lie_where_they_were_put(
    arena: SimpleNamespace, timestep: float, substeps: int
):
    """Against the closed loop built by a slow loop over the integrator's substeps."""
    config = Config(sim=SimConfig(timestep=timestep, substeps=substeps))
    body = autopilot.airframe(config, arena.combat.scene, DEFENDER)
    columns = []
    for angle, rate in ((1.0, 0.0), (0.0, 1.0)):
        acceleration = -body.attitude_gain * angle - body.rate_gain * rate
        for _ in range(substeps):
            rate += timestep * acceleration
            angle += timestep * rate
        columns.append((angle, rate))
    poles = np.linalg.eigvals(np.array(columns).T)
    # a double pole: the square root of rounding
    np.testing.assert_allclose(poles, autopilot.POLE, atol=1e-4)
    assert abs(1.0 - body.spin_gain * timestep * substeps) < 1.0


@pytest.mark.parametrize("seed", [0, 1])
def test_hover_recovers_from_a_right_angle_and_a_spin(
    arena: SimpleNamespace, fresh: EnvState, seed: int
):
    """90 degrees of tilt about eight axes and 10 rad/s, 1 m above the ground."""
    random = np.random.default_rng(seed)
    heading, spin = random.uniform(0, 2 * np.pi, arena.size), random.normal(size=(arena.size, 3))
    qpos, qvel = np.array(fresh.qpos), np.array(fresh.qvel)
    qpos[:, 2], half = 1.0, np.sqrt(0.5)
    qpos[:, 3:7] = np.stack(
        [0 * heading + half, half * np.cos(heading), half * np.sin(heading), 0 * heading], axis=-1
    )
    qvel[:, 3:6] = 10 * spin / np.linalg.norm(spin, axis=-1, keepdims=True)
    path = fly_defender(arena, fresh.replace(qpos=jnp.asarray(qpos), qvel=jnp.asarray(qvel)), 100)
    assert np.all(path[..., 2] > 0.6)  # it falls 0.2 m while it turns, and brakes
    cosine = 1 - 2 * (path[..., 4] ** 2 + path[..., 5] ** 2)
    assert np.all(cosine[15:] > np.cos(np.radians(15))) and np.all(
        cosine[-1] > np.cos(np.radians(1))
    )
    assert np.all(np.linalg.norm(path[-1, :, 7:], axis=-1) < 0.05)


def test_hover_stays_for_four_seconds(arena: SimpleNamespace, fresh: EnvState):
    path = fly_defender(arena, fresh, 200)
    assert np.max(np.linalg.norm(path[..., :3] - np.asarray(fresh.qpos)[:, :3], axis=-1)) < 0.02


@pytest.mark.parametrize("name", ["pure_pursuit", "proportional_navigation"])
def test_what_does_not_run_is_caught(arena: SimpleNamespace, fresh: EnvState, name: str):
    pilot = jax.jit(scripted.build_pilot(name, arena.combat.config, arena.combat.scene))
    still = jnp.tile(jnp.asarray(STILL), (arena.size, 1))
    state, caught = fresh, np.zeros(arena.size, bool)
    for _ in range(60):
        state, output = arena.step(state, jnp.stack([pilot(state, None, KEY), still], axis=1))
        caught |= np.asarray(output.cause) == Cause.INTERCEPT
    assert np.all(caught)


def test_thrust_limit_keeps_the_altitude(body: autopilot.Airframe):
    """Vertical demands come through whole, horizontal ones get what is left, in their direction."""
    g, most = body.gravity, body.max_force
    wanted = jnp.array([[100.0, 0, 0], [30, -40, 2], [1, 1, 1], [0, 0, 100], [5, 0, -100]])
    high, at_rest = jnp.full(5, 50.0), jnp.zeros(5)
    force = autopilot.attainable(body, high, at_rest, wanted)
    rest = np.sqrt(most**2 - (g + 2) ** 2)
    expected = [
        [np.sqrt(most**2 - g**2), 0, g],
        [0.6 * rest, -0.8 * rest, g + 2],
        [1, 1, g + 1],
        [0, 0, most],
    ]
    np.testing.assert_allclose(force[:4], expected, rtol=1e-4, atol=1e-2)
    np.testing.assert_allclose(force[4], [5, 0, autopilot.MIN_LIFT * g], rtol=1e-4)


def test_a_descent_near_the_floor_is_braked(body: autopilot.Airframe):
    altitude, climb = jnp.array([3.0, 0.6, 0.3]), jnp.array([0.0, -3.0, 0.0])
    lift = autopilot.attainable(body, altitude, climb, jnp.zeros((3, 3)).at[:, 2].set(-5.0))[:, 2]
    assert lift[0] == pytest.approx(body.gravity - 5.0, rel=1e-4)
    assert lift[1] == pytest.approx(body.max_force, rel=1e-4) and lift[2] >= body.gravity


def test_full_thrust_holds_what_is_asked_across(body: autopilot.Airframe):
    """|across + s along - gravity| is the full thrust, and the part across is kept."""
    along = jnp.array([[0.6, 0.8, 0.0], [0.6, 0.0, 0.8], [0.8, 0.0, -0.6]])
    across = jnp.array([[-0.8, 0.6, 0.5], [0.0, 3.0, 0.0], [0.0, -2.0, 0.0]])
    wanted = guidance.full_thrust(body, along, across)
    part = jnp.sum(wanted * along, axis=-1, keepdims=True)
    np.testing.assert_allclose(wanted - part * along, across, atol=1e-4)
    force = np.asarray(wanted + jnp.array([0, 0, body.gravity]))
    np.testing.assert_allclose(np.linalg.norm(force[:2], axis=-1), body.max_force, rtol=1e-4)
    assert (
        force[2, 2] == pytest.approx(autopilot.MIN_LIFT * body.gravity, rel=1e-3) and part[2, 0] > 0
    )


@pytest.mark.parametrize("name", NAMES)
def test_a_pilot_is_pure_and_vectorised(arena: SimpleNamespace, name: str):
    """Finite, within the limits, each fight on its own, whatever the key and the observation."""
    pilot = jax.jit(scripted.build_pilot(name, arena.combat.config, arena.combat.scene))
    state = random_state(1, arena.size)
    action = np.asarray(pilot(state, jnp.zeros((arena.size, 2, 35)), KEY))
    # NaN would compare false
    assert action.shape == (arena.size, 4) and np.all(np.abs(action) <= 1.0)
    np.testing.assert_array_equal(
        action, pilot(state, jnp.ones((arena.size, 2, 35)), jax.random.key(1))
    )
    turned = jax.tree.map(lambda leaf: jnp.roll(leaf, 3, axis=0), state)
    np.testing.assert_allclose(np.roll(action, 3, axis=0), pilot(turned, None, KEY), atol=1e-4)


@pytest.mark.parametrize("name", NAMES)
def test_a_pilot_survives_degenerate_states(arena: SimpleNamespace, name: str):
    """Drones and target in one place, at rest, one drone upside down: no direction is defined."""
    pose = (
        jnp.tile(jnp.array([1.0, 1, 1, 0, 1, 0, 0, 1, 1, 1, 0, 1, 0, 0]), (2, 1))
        .at[1, jnp.array([3, 10])]
        .set(1.0)
    )
    pose = pose.at[1, jnp.array([4, 11])].set(0.0)
    state = EnvState(
        pose, jnp.zeros((2, 12)), jnp.ones((2, 3)), jnp.zeros(2, jnp.int32), jnp.zeros((2, 2), bool)
    )
    action = scripted.build_pilot(name, arena.combat.config, arena.combat.scene)(state, None, KEY)
    assert np.all(np.abs(np.asarray(action)) <= 1.0)


@pytest.mark.long
def test_each_fight_gets_its_own_pilot(arena: SimpleNamespace):
    names = list(scripted.PILOTS[ATTACKER])
    pilots = [scripted.build_pilot(name, arena.combat.config, arena.combat.scene) for name in names]
    state, which = random_state(2, 6), jnp.array([2, 0, 1, 1, 0, 2])
    mixed = scripted.one_per_fight(pilots, which)(state, None, KEY)
    for fight, pilot in enumerate(np.asarray(which)):
        np.testing.assert_array_equal(mixed[fight], pilots[pilot](state, None, KEY)[fight])


def test_an_unknown_name_lists_those_there_are(arena: SimpleNamespace):
    with pytest.raises(UserError) as error:
        scripted.build_pilot("kamikaze", arena.combat.config, arena.combat.scene)
    assert error.value.exit_code == 2 and "\n" not in error.value.message
    assert all(name in error.value.message for name in ["kamikaze", *NAMES])
    assert len(set(NAMES)) == len(NAMES)


def test_a_goalkeeper_reckons_with_an_attacker_that_speeds_up(body: autopilot.Airframe):
    """The attacker at rest, 6 m from the target; the keeper 3 m from the target, on the same line."""
    keeper = guidance.KEEPER
    push = keeper.stance.push * body.max_force  # pyright: ignore[reportOptionalOperand]
    at = lambda x: jnp.asarray([[x, 0.0, 1.0]])
    rest, up = jnp.zeros((1, 3)), jnp.asarray([[0.0, 0.0, 1.0]])
    now = guidance.Situation(at(3.0), rest, up, at(6.0), rest, up, at(0.0), jnp.zeros(1))
    wanted = guidance.goalkeeper(body, now)[0]
    away, arrival = 3.0 - keeper.distance, np.sqrt(2.0 * (6.0 - keeper.distance) / push)
    speed = max(
        keeper.stance.hurry * away / arrival,
        min(keeper.stance.gain * away, np.sqrt(2.0 * keeper.stance.braking * away)),
    )
    np.testing.assert_allclose(
        wanted, [-keeper.stance.velocity_gain * speed, 0.0, 0.0], rtol=1e-4, atol=1e-4
    )
    # in time it hurries more than against one that keeps its speed, which is 0 here
    plain = keeper._replace(stance=keeper.stance._replace(push=None, gain=0.0))
    hurried = keeper._replace(stance=keeper.stance._replace(gain=0.0))
    assert not np.any(guidance.goalkeeper(body, now, plain))
    assert guidance.goalkeeper(body, now, hurried)[0, 0] < 0.0
