"""Flight: MJX against C MuJoCo's `implicit` integrator, tumbling, hovering, and the small matrices."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from dronecombat_jax.config import SimConfig
from dronecombat_jax.sim.flight import build_step, hover_command, limit_rate, skew, solve_3x3, split, wrench
from dronecombat_jax.sim.scene import Scene, load_scene

STEPS = 100  # control steps, 2 s
PLACES = np.array([0, 5, 1, 1, 0, 0, 0, 0, 0, 1, 1, 0, 0, 0], np.float32)
SPIN = np.array([1.0, 1.0, 1.0]) / np.sqrt(3.0)  # direction of the tumbles of the specification
HOVER = hover_command(SimConfig().thrust_to_weight)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(SimConfig())


@pytest.fixture(scope="module")
def flight(scene: Scene) -> SimpleNamespace:
    """Four scenes flown by one program at the default settings; see `cases` for what each one does."""
    qvel, action = cases()
    path = jax.jit(path_of(SimConfig(), scene))(np.tile(PLACES, (len(qvel), 1)), qvel, action)
    return SimpleNamespace(qpos=np.asarray(path[0]), qvel=np.asarray(path[1]), start=qvel, action=action)


KICK, STRUGGLE, STILL, SPINNING = range(4)


def cases() -> tuple[np.ndarray, np.ndarray]:
    """Start velocities [4, 12] and actions [T, 4, A, 4]."""
    random = np.random.default_rng(0)
    qvel = np.zeros((4, 12), np.float32)
    action = np.zeros((STEPS, 4, 2, 4), np.float32)
    action[:, STILL, :, 0] = HOVER
    qvel[KICK] = [1, -2, 0.5, 3, -4, 2, -1, 0.5, 2, -6, 2, 5]
    action[:, KICK, :, 0] = random.uniform(-1, 1, (STEPS, 2))  # no moments: the kick alone turns the drone
    qvel[STRUGGLE] = -qvel[KICK]
    action[:, STRUGGLE] = random.uniform(-1, 1, (STEPS, 2, 4))  # what a policy at its start does
    action[:, SPINNING] = [1.0, 1.0, 0.0, 0.0]  # full moment about x, forever
    return qvel, action


def path_of(sim: SimConfig, scene: Scene):
    """`fly(qpos [N, 14], qvel [N, 12], action [T, N, A, 4]) -> (qpos, qvel)`, each [T, N, ...]."""
    step = jax.vmap(build_step(sim, scene))

    def advance(state, action):
        state = step(*state, action)
        return state, state

    return lambda qpos, qvel, action: jax.lax.scan(advance, (qpos, qvel), action)[1]


def reference(scene: Scene, qvel: np.ndarray, action: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """The same flight in C MuJoCo through the full scene's actuators; `action` None: no forces, no gravity."""
    model = scene.full.__copy__()
    data, path = mujoco.MjData(model), []
    data.qpos[:], data.qvel[:] = PLACES, qvel
    if action is None:
        model.opt.gravity[:] = 0
    for step in range(STEPS):
        if action is not None:
            for drone, columns in enumerate(scene.controls):
                low, high = model.actuator_ctrlrange[columns].T
                data.ctrl[columns] = low + (action[step, drone] + 1) / 2 * (high - low)
        mujoco.mj_step(model, data, 2)
        path.append((data.qpos.copy(), data.qvel.copy()))
    return tuple(np.array(part) for part in zip(*path, strict=True))


@pytest.mark.parametrize("case", [KICK, STRUGGLE])
def test_agrees_with_the_implicit_integrator_of_c_mujoco(scene: Scene, flight: SimpleNamespace, case: int):
    assert scene.full.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICIT
    qpos, qvel = reference(scene, flight.start[case], flight.action[:, case])
    ours, theirs = split(flight.qpos[:, case], flight.qvel[:, case]), split(qpos, qvel)
    assert np.linalg.norm(theirs.rate, axis=-1).max() < SimConfig().max_body_rate  # C has no cap
    np.testing.assert_allclose(ours.position, theirs.position, atol=1e-3)
    np.testing.assert_allclose(ours.rate, theirs.rate, atol=1e-2)
    same_sign = np.sign(np.sum(ours.quaternion * theirs.quaternion, axis=-1, keepdims=True))
    np.testing.assert_allclose(ours.quaternion * same_sign, theirs.quaternion, atol=1e-3)
    np.testing.assert_allclose(ours.velocity, theirs.velocity, atol=2e-3)


def test_hover_command_holds_altitude(flight: SimpleNamespace):
    assert pytest.approx(0.0526, abs=1e-4) == HOVER
    one_second = flight.qpos[:50, STILL]
    np.testing.assert_allclose(one_second, np.tile(PLACES, (50, 1)), atol=1e-3)


def test_rate_stays_under_the_cap(flight: SimpleNamespace):
    rate = np.linalg.norm(split(flight.qpos[:, SPINNING], flight.qvel[:, SPINNING]).rate, axis=-1)
    assert rate.max() <= 100.0 * (1 + 1e-6)
    assert rate[-1].min() > 99.0  # without the cap: 0.01 N m / 2.1e-5 kg m^2 * 2 s = 940 rad/s


def test_cap_keeps_direction_velocity_and_slow_rates():
    qvel = np.array([7, 8, 9, 0, 300, 400, 1, 2, 3, 60, 0, 80], np.float32)
    limited = np.asarray(limit_rate(qvel, 100.0))
    np.testing.assert_allclose(limited, [7, 8, 9, 0, 60, 80, 1, 2, 3, 60, 0, 80], rtol=1e-6)
    np.testing.assert_array_equal(limit_rate(np.zeros(12, np.float32), 100.0), np.zeros(12))


@pytest.fixture(scope="module")
def tumbles(scene: Scene) -> dict[str, np.ndarray]:
    """Body rates [T, N, 3] of torque-free tumbles without a cap, by `gyroscopic`; see `tumble_starts`."""
    start = np.zeros((len(tumble_starts()), 12), np.float32)
    start[:, 3:6] = tumble_starts()
    still = np.full((STEPS, len(start), 2, 4), 0.0, np.float32)
    still[..., 0] = -1.0
    rates = {}
    for kind in ("implicit", "explicit"):
        fly = jax.jit(path_of(SimConfig(gyroscopic=kind, max_body_rate=1e4), scene))
        rates[kind] = np.asarray(fly(np.tile(PLACES, (len(start), 1)), start, still)[1])[..., 3:6]
    return rates


def tumble_starts() -> np.ndarray:
    """Rates [9, 3] in rad/s: 20, 40, 100 about each of three directions, the specification's first."""
    directions = np.array([SPIN, [0.6, 0.0, 0.8], [0.0, -0.98, 0.2]])
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return np.concatenate([speed * directions for speed in (20.0, 40.0, 100.0)])


def energy(scene: Scene, rate: np.ndarray) -> np.ndarray:
    return 0.5 * np.sum(scene.inertia[0] * rate.astype(np.float64) ** 2, axis=-1)


def test_tumble_never_gains_energy(scene: Scene, tumbles: dict[str, np.ndarray]):
    rates = np.concatenate([tumble_starts()[None], tumbles["implicit"]])
    path = energy(scene, rates)
    assert np.all(np.isfinite(path))
    assert np.all(path[1:] <= path[:-1] * (1 + 1e-5))


def test_tumble_loses_what_it_loses_in_c_mujoco(scene: Scene, tumbles: dict[str, np.ndarray]):
    for index, start in enumerate(tumble_starts()):
        qvel = np.zeros(12)
        qvel[3:6] = start
        _, theirs = reference(scene, qvel, None)
        np.testing.assert_allclose(tumbles["implicit"][:, index], theirs[:, 3:6], atol=2e-2)
    final = np.linalg.norm(tumbles["implicit"][-1, [0, 3]], axis=-1)
    np.testing.assert_allclose(final, [15.24, 28.0], atol=0.05)


def test_explicit_gyroscopic_torque_diverges(scene: Scene, tumbles: dict[str, np.ndarray]):
    final = energy(scene, tumbles["explicit"][-1])
    gained = final > 1.2 * energy(scene, tumble_starts())
    assert np.all((gained | ~np.isfinite(final))[[0, 3, 6]])
    assert not np.isfinite(final[6])


def test_wrench_turns_with_the_body_at_every_substep(scene: Scene):
    """Rolling at 20 rad/s: thrust pushes along z in the first substep, along z turned by 0.2 rad in the second."""
    step = jax.jit(build_step(SimConfig(), scene))
    qvel = np.zeros(12, np.float32)
    qvel[3] = 20.0  # about a principal axis: the rate stays
    action = np.array([[1.0, 0, 0, 0], [-1.0, 0, 0, 0]], np.float32)
    _, after = step(PLACES, qvel, action)
    h, g = 0.01, 9.81
    push = 1.9 * g * h * np.array([0.0, -np.sin(0.2), 1.0 + np.cos(0.2)])
    np.testing.assert_allclose(after[:6], [*(push - [0, 0, 2 * g * h]), 20, 0, 0], atol=1e-5)
    np.testing.assert_allclose(after[6:], [0, 0, -2 * g * h, 0, 0, 0], atol=1e-6)


def test_wrench_is_clipped_and_scaled():
    """Thrust 1.9 weights at u0 = 1, none at -1; moments 0.01 N m at full deflection (eq. 7, 8)."""
    full = jnp.array([1.9 * 0.276642, 1.9 * 0.276642])
    thrust, moment = wrench(jnp.array([[5.0, 1e30, -0.5, -7.0], [HOVER, 0.0, 1.0, -jnp.inf]]), full, 0.01)
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
    np.testing.assert_allclose(solve_3x3(tiny, np.ones(3, np.float32)), 1 / np.diag(tiny), rtol=1e-5)
