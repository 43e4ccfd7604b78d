"""Flight: MJX against C MuJoCo's `implicit` integrator, tumbling, hovering, and the small matrices."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.sim.flight import (
    build_step,
    hover_command,
    limit_rate,
    skew,
    solve_3x3,
    split,
    wrench,
)
from dronecombat_jax.sim.scene import Scene

STEPS = 100  # control steps, 2 s
PLACES = np.array([0, 5, 1, 1, 0, 0, 0, 0, 0, 1, 1, 0, 0, 0], np.float32)
HOVER = hover_command(SimConfig().thrust_to_weight)

# Tumbles: 20, 40, 100 rad/s about three directions; the specification's numbers are for the first.
DIRECTIONS = np.array([[1.0, 0.2, 1.0], [0.6, 0.5, 0.62], [0.0, -0.98, 0.2]])
TUMBLES = np.concatenate(
    [v * DIRECTIONS / np.linalg.norm(DIRECTIONS, axis=1)[:, None] for v in (20.0, 40.0, 100.0)]
)
KICK, STRUGGLE, STILL, ROLLING, TUMBLE = 0, 1, 2, 3, slice(4, 4 + len(TUMBLES))
CAP = 150.0  # rad/s; above the default, as C MuJoCo has none and the struggle goes beyond 100


@pytest.fixture(scope="module")
def flights(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Paths `qpos [T, N, 14]`, `qvel [T, N, 12]` of `cases`."""
    qvel, action = cases()
    return fly(SimConfig(max_body_rate=CAP), scene, qvel, action)


def fly(
    sim: SimConfig, scene: Scene, qvel: np.ndarray, action: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Fly from `PLACES` with velocities [N, 12] and actions [T, N, A, 4]."""
    step = jax.vmap(build_step(sim, scene))

    def advance(state, action):
        state = step(state[0], state[1], action)
        return state, state

    start = (jnp.tile(PLACES, (len(qvel), 1)), jnp.asarray(qvel))
    path = jax.jit(lambda start, action: jax.lax.scan(advance, start, action)[1])(start, action)
    return np.asarray(path[0]), np.asarray(path[1])


def cases() -> tuple[np.ndarray, np.ndarray]:
    """Start velocities [N, 12] and actions [T, N, A, 4]."""
    random = np.random.default_rng(0)
    qvel = np.zeros((TUMBLE.stop, 12), np.float32)
    action = np.zeros((STEPS, TUMBLE.stop, 2, 4), np.float32)
    qvel[KICK] = [1, -2, 0.5, 3, -4, 2, -1, 0.5, 2, -6, 2, 5]
    # no moments: the kick alone turns the drones
    action[:, KICK, :, 0] = random.uniform(-1, 1, (STEPS, 2))
    qvel[STRUGGLE] = -qvel[KICK]
    action[:, STRUGGLE] = random.uniform(-1, 1, (STEPS, 2, 4))  # what an untrained policy does
    action[:, STILL, :, 0] = HOVER
    qvel[ROLLING, 3] = 20.0
    action[:, ROLLING] = [[1.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0]]
    qvel[TUMBLE, 3:6] = TUMBLES
    return qvel, action


def in_c_mujoco(
    scene: Scene, qvel: np.ndarray, action: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The same flight `(qpos [T, 14], qvel [T, 12])` in C MuJoCo, through the actuators of the full
    scene.
    """
    data, path = mujoco.MjData(scene.full), []
    data.qpos[:], data.qvel[:] = PLACES, qvel
    low, high = scene.full.actuator_ctrlrange[scene.controls].transpose(2, 0, 1)
    for u in action:
        data.ctrl[scene.controls] = low + (u + 1) / 2 * (high - low)
        mujoco.mj_step(scene.full, data, 2)
        path.append((data.qpos.copy(), data.qvel.copy()))
    return np.array([qpos for qpos, _ in path]), np.array([qvel for _, qvel in path])


@pytest.mark.parametrize("case", [KICK, STRUGGLE])
@pytest.mark.long
def test_agrees_with_the_implicit_integrator_of_c_mujoco(scene: Scene, flights: tuple, case: int):
    assert scene.full.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICIT
    qpos, qvel = flights
    start, action = cases()
    theirs = split(*in_c_mujoco(scene, start[case], action[:, case]))
    ours = split(qpos[:, case], qvel[:, case])
    np.testing.assert_allclose(ours.position, theirs.position, atol=1e-3)
    np.testing.assert_allclose(ours.rate, theirs.rate, atol=1e-2)
    np.testing.assert_allclose(ours.velocity, theirs.velocity, atol=2e-3)
    # q and -q are one attitude
    cosine = np.abs(np.sum(ours.quaternion * theirs.quaternion, axis=-1))
    np.testing.assert_allclose(cosine, 1.0, atol=1e-5)


def test_hover_command_holds_altitude(flights: tuple):
    assert pytest.approx(0.0526, abs=1e-4) == HOVER
    one_second = flights[0][:50, STILL]
    np.testing.assert_allclose(one_second, np.tile(PLACES, (50, 1)), atol=1e-3)


def energy(scene: Scene, rate: np.ndarray) -> np.ndarray:
    return 0.5 * np.sum(scene.inertia[0] * rate.astype(np.float64) ** 2, axis=-1)


def test_tumble_never_gains_energy(scene: Scene, flights: tuple):
    path = energy(scene, np.concatenate([TUMBLES[None], flights[1][:, TUMBLE, 3:6]]))
    assert np.all(np.isfinite(path))
    assert np.all(path[1:] <= path[:-1] * (1 + 1e-5))


def test_tumble_loses_what_it_loses_in_c_mujoco(scene: Scene, flights: tuple):
    start, action = cases()
    ours = flights[1][:, TUMBLE, 3:6]
    for tumble in range(len(TUMBLES)):
        case = TUMBLE.start + tumble
        theirs = in_c_mujoco(scene, start[case], action[:, case])[1][:, 3:6]
        np.testing.assert_allclose(ours[:, tumble], theirs, atol=2e-2)
    final = np.linalg.norm(ours[-1, [0, 3]], axis=-1)
    np.testing.assert_allclose(final, [15.24, 28.0], atol=0.02)


def test_explicit_gyroscopic_torque_diverges(scene: Scene):
    """So that the tests above can fail: 20 -> 36 rad/s, 40 -> 860, 100 -> no end."""
    sim = SimConfig(gyroscopic="explicit", max_body_rate=1e4, substeps=1)
    qvel = np.zeros((3, 12), np.float32)
    qvel[:, 3:6] = TUMBLES[::3]
    final = np.linalg.norm(
        fly(sim, scene, qvel, np.zeros((2 * STEPS, 3, 2, 4), np.float32))[1][-1, :, 3:6], axis=-1
    )
    assert final[0] == pytest.approx(36.6, abs=0.5)
    assert final[1] > 500
    assert final[2] > 5000  # held by the cap of this test at 1e4


def test_wrench_turns_with_the_body_at_every_substep(flights: tuple):
    """Rolling at 20 rad/s under full thrust: in the second substep it pushes along a z that has
    turned.

    The moment 0.01 N m about x, a principal axis, adds h m / I before the body turns by h w.
    """
    h, g, inertia_x = 0.01, 9.81, 2.1236e-5
    turned = h * (20.0 + h * 0.01 / inertia_x)
    push = 1.9 * g * h * np.array([0.0, -np.sin(turned), 1.0 + np.cos(turned)])
    qvel = flights[1][0, ROLLING]
    np.testing.assert_allclose(qvel[:3], push - [0, 0, 2 * g * h], atol=1e-5)
    np.testing.assert_allclose(qvel[3:6], [20.0 + 2 * h * 0.01 / inertia_x, 0, 0], rtol=1e-5)
    np.testing.assert_allclose(qvel[6:], [0, 0, -2 * g * h, 0, 0, 0], atol=1e-6)


def test_rate_stays_under_the_cap(flights: tuple):
    """A full moment for 2 s would make 940 rad/s."""
    assert SimConfig().max_body_rate == 100.0
    rate = np.linalg.norm(split(flights[0], flights[1])[3], axis=-1)
    assert rate.max() <= CAP * (1 + 1e-6)
    assert rate[-1, ROLLING, 0] == pytest.approx(CAP, rel=1e-5)
    # so that the comparison with C MuJoCo, which has no cap, holds
    assert rate[:, STRUGGLE].max() < 0.95 * CAP


def test_cap_keeps_direction_velocity_and_slow_rates():
    qvel = np.array([7, 8, 9, 0, 300, 400, 1, 2, 3, 60, 0, 80], np.float32)
    limited = np.asarray(limit_rate(qvel, 100.0))
    np.testing.assert_allclose(limited, [7, 8, 9, 0, 60, 80, 1, 2, 3, 60, 0, 80], rtol=1e-6)
    np.testing.assert_array_equal(limit_rate(np.zeros(12, np.float32), 100.0), np.zeros(12))


def test_wrench_is_clipped_and_scaled():
    """Thrust 1.9 weights at u0 = 1, none at -1; moments 0.01 N m at full deflection (eq. 7, 8)."""
    full = jnp.array([1.9 * 0.276642, 1.9 * 0.276642])
    thrust, moment = wrench(
        jnp.array([[5.0, 1e30, -0.5, -7.0], [HOVER, 0.0, 1.0, -jnp.inf]]), full, 0.01
    )
    np.testing.assert_allclose(thrust, [1.9 * 0.276642, 0.276642], rtol=1e-6)
    np.testing.assert_allclose(moment, [[0.01, -0.005, -0.01], [0.0, 0.01, -0.01]], rtol=1e-6)
    np.testing.assert_array_equal(wrench(jnp.full((2, 4), -1.0), full, 0.01)[0], [0.0, 0.0])


def test_skew_and_solve_agree_with_numpy():
    random = np.random.default_rng(3)
    u, v = random.normal(size=(2, 40, 3)).astype(np.float32)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", skew(u), v), np.cross(u, v), atol=1e-6)
    matrix = (random.normal(size=(40, 3, 3)) + 3 * np.eye(3)).astype(np.float32)
    expected = np.linalg.solve(matrix.astype(np.float64), v[..., None])[..., 0]
    np.testing.assert_allclose(solve_3x3(matrix, v), expected, rtol=2e-4, atol=1e-5)
    tiny = np.diag([2e-5, 2e-5, 3.5e-5]).astype(np.float32)  # an inertia: its determinant is 1e-14
    np.testing.assert_allclose(
        solve_3x3(tiny, np.ones(3, np.float32)), 1 / np.diag(tiny), rtol=1e-5
    )
