"""The observation: its layout by hand, its frames against C MuJoCo, and what `ego` keeps and
forgets.
"""

import jax
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dronecombat_jax.combat.observe import WORLD_FIELDS, observe_ego, observe_world
from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.sim.flight import split
from dronecombat_jax.sim.scene import load_scene
from dronecombat_jax.types import OBSERVATION_SIZE, Drones

# Where each part lies, e.g. PART["p_t"].
ENDS = np.cumsum([size for _, size in WORLD_FIELDS])
PART = {name: slice(end - size, end) for (name, size), end in zip(WORLD_FIELDS, ENDS, strict=True)}
HALF = np.sqrt(0.5)

world, ego = jax.jit(observe_world), jax.jit(observe_ego)


@pytest.fixture
def state() -> tuple[Drones, np.ndarray]:
    """A defender yawed by 90 degrees to the left, an attacker rolled by 90 degrees to the right,
    and a target.
    """
    drones = Drones(
        position=np.array([[1, 2, 3], [4, 6, 5]], np.float32),
        quaternion=np.array([[HALF, 0, 0, HALF], [HALF, HALF, 0, 0]], np.float32),
        velocity=np.array([[10, 20, 30], [40, 50, 60]], np.float32),
        rate=np.array([[7, 8, 9], [-1, -2, -3]], np.float32),
    )
    return drones, np.array([5, 5, 1], np.float32)


@pytest.fixture
def tumbled() -> tuple[Drones, np.ndarray]:
    """Nothing zero, nothing aligned."""
    random = np.random.default_rng(5)
    fields = [random.normal(size=(2, 3)), Rotation.random(2, random).as_quat(scalar_first=True)]
    fields += [random.normal(size=(2, 3)), random.normal(size=(2, 3))]
    return Drones(*(field.astype(np.float32) for field in fields)), np.array(
        [5, 5, 1.3], np.float32
    )


def test_layout_is_that_of_equation_5():
    names = "p_d q_d p_a q_a p_t v_d w_d v_a w_a g_d g_a"
    assert " ".join(name for name, _ in WORLD_FIELDS) == names
    assert [size for _, size in WORLD_FIELDS] == [3, 4, 3, 4, 3, 3, 3, 3, 3, 3, 3]
    assert ENDS[-1] == OBSERVATION_SIZE == 35


def test_world_observation_by_hand(state):
    """Yawed: body x is world y, body y is world -x. Rolled: body y is world z, body z is world -y."""
    row = [
        *(1, 2, 3), *(HALF, 0, 0, HALF), *(4, 6, 5), *(HALF, HALF, 0, 0), *(5, 5, 1),
        *(20, -10, 30), *(7, 8, 9), *(40, 60, -50), *(-1, -2, -3), *(0, 0, -1), *(0, -1, 0),
    ]  # fmt: skip
    observation = world(*state)
    assert observation.shape == (2, 35) and observation.dtype == np.float32
    np.testing.assert_allclose(observation, [row, row], atol=1e-5)


def test_ego_observation_by_hand(state):
    """Each row: self in world coordinates, then all else in the own frame; the other is d minus a
    or a minus d.

    To the defender the attacker is at (3, 4, 2): 4 ahead, 3 to the right, 2 above. To the attacker
    the defender is at (-3, -4, -2): x -3, y -2 (world z), z 4 (minus world y). Rates: the
    attacker's (-1, -2, -3) is (-1, 3, -2) in the world; the defender's (7, 8, 9) is (-8, 7, 9).
    """
    # the attacker's attitude seen from the defender; its inverse from the attacker
    other = [0.5, 0.5, -0.5, -0.5]
    inverse = [0.5, -0.5, 0.5, 0.5]
    rows = [
        [
            *(1, 2, 3), *(HALF, 0, 0, HALF), *(4, -3, 2), *other, *(3, -4, -2),
            *(20, -10, 30), *(7, 8, 9), *(50, -40, 60), *(3, 1, -2), *(0, 0, -1), *(0, -1, 0),
        ],
        [
            *(4, 6, 5), *(HALF, HALF, 0, 0), *(-3, -2, 4), *inverse, *(1, -4, 1),
            *(40, 60, -50), *(-1, -2, -3), *(10, 30, -20), *(-8, 9, -7), *(0, -1, 0), *(0, 0, -1),
        ],
    ]  # fmt: skip
    np.testing.assert_allclose(ego(*state), rows, atol=1e-5)


def test_frames_of_qvel_are_those_of_mujoco():
    """A free joint's qvel: linear in the world frame, angular in the body frame (the trap)."""
    model = load_scene(SimConfig()).full
    random, data, twist = np.random.default_rng(1), mujoco.MjData(model), np.zeros(6)
    data.qpos[:] = random.normal(size=14)
    mujoco.mj_normalizeQuat(model, data.qpos)
    data.qvel[:] = random.normal(size=12)
    mujoco.mj_forward(model, data)
    drones = split(data.qpos.astype(np.float32), data.qvel.astype(np.float32))
    observation = world(drones, np.zeros(3, np.float32))[0]
    for name, short in (("defender", "d"), ("attacker", "a")):
        body = model.body(name).id
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, twist, 1)
        np.testing.assert_allclose(observation[PART[f"v_{short}"]], twist[3:], atol=1e-5)
        np.testing.assert_allclose(observation[PART[f"w_{short}"]], twist[:3], atol=1e-5)
        down = data.xmat[body].reshape(3, 3).T @ (0, 0, -1)
        np.testing.assert_allclose(observation[PART[f"g_{short}"]], down, atol=1e-5)
        np.testing.assert_allclose(observation[PART[f"p_{short}"]], data.xpos[body], atol=1e-6)


def test_ego_keeps_its_relative_parts_when_the_world_is_turned_and_moved(tumbled):
    drones, target = tumbled
    turn, shift = Rotation.from_euler("z", 0.7), np.array([2.0, -3.0, 0.0])
    moved = lambda place: turn.apply(place) + shift
    attitude = turn * Rotation.from_quat(drones.quaternion, scalar_first=True)
    elsewhere = Drones(
        moved(drones.position),
        attitude.as_quat(scalar_first=True),
        turn.apply(drones.velocity),
        drones.rate,
    )
    here, there = np.asarray(ego(drones, target)), np.asarray(ego(elsewhere, moved(target)))
    relative = [part for name, part in PART.items() if name not in ("p_d", "q_d", "q_a")]
    for part in relative:
        np.testing.assert_allclose(there[:, part], here[:, part], atol=1e-5)
    # q and -q are one attitude
    cosine = np.abs(np.sum(there[:, PART["q_a"]] * here[:, PART["q_a"]], axis=-1))
    np.testing.assert_allclose(cosine, 1.0, atol=1e-5)
    np.testing.assert_allclose(there[:, :7], np.concatenate(elsewhere[:2], axis=-1), atol=1e-5)
    assert np.abs(there[:, :2] - here[:, :2]).max() > 1.0


def test_ego_holds_the_same_information_as_world(tumbled):
    """The other's world state, rebuilt from what one drone sees of it."""
    drones, target = tumbled
    rows = np.asarray(ego(drones, target))
    for self, row in enumerate(rows):
        other, own = 1 - self, Rotation.from_quat(row[3:7], scalar_first=True)
        see = lambda name, row=row: row[PART[name]]
        attitude = own * Rotation.from_quat(see("q_a"), scalar_first=True)
        np.testing.assert_allclose(
            row[:3] + own.apply(see("p_a")), drones.position[other], atol=1e-5
        )
        np.testing.assert_allclose(row[:3] + own.apply(see("p_t")), target, atol=1e-5)
        np.testing.assert_allclose(own.apply(see("v_d")), drones.velocity[self], atol=1e-5)
        np.testing.assert_allclose(own.apply(see("v_a")), drones.velocity[other], atol=1e-5)
        np.testing.assert_allclose(see("w_d"), drones.rate[self], atol=1e-6)
        np.testing.assert_allclose(
            attitude.inv().apply(own.apply(see("w_a"))), drones.rate[other], atol=1e-5
        )
        np.testing.assert_allclose(own.apply(see("g_d")), (0, 0, -1), atol=1e-5)
        np.testing.assert_allclose(attitude.apply(see("g_a")), (0, 0, -1), atol=1e-5)
