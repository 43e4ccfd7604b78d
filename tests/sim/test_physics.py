"""Physics: the phases that are left out are nothing, for every body and any pose."""

from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from drones import BIG, write

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.sim import physics
from dronecombat_jax.sim.flight import split
from dronecombat_jax.sim.flown import BODIES
from dronecombat_jax.sim.scene import Scene, load_scene

FLIGHTS, STEPS = 200, 4


def states(scene: Scene) -> tuple[np.ndarray, ...]:
    """Random `qpos [N, 14]`, `qvel [N, 12]`, `force [N, 12]`: all over the arena, any attitude,
    spins up to 100 rad/s.

    Quaternions are off unit length, as nothing but the step itself keeps them there.
    """
    random = np.random.default_rng(0)
    direction = lambda size: (
        (v := random.normal(size=(FLIGHTS, 2, size))) / np.linalg.norm(v, axis=-1, keepdims=True)
    )
    attitude = direction(4) * random.uniform(0.99, 1.01, (FLIGHTS, 2, 1))
    pose = np.concatenate([random.uniform(-8, 8, (FLIGHTS, 2, 3)), attitude], axis=-1)
    spin = direction(3) * random.uniform(0, 100, (FLIGHTS, 2, 1))
    twist = np.concatenate([random.uniform(-10, 10, (FLIGHTS, 2, 3)), spin], axis=-1)
    push = direction(3) * 2.0 * scene.weight[:, None]
    force = np.concatenate([push, random.uniform(-0.01, 0.01, (FLIGHTS, 2, 3))], axis=-1)
    return tuple(part.reshape(FLIGHTS, -1).astype(np.float32) for part in (pose, twist, force))


def whole_step(scene: Scene) -> Any:
    """What `build_physics` makes, by `mjx.step` on MJX's own blank data."""
    mjx, model, _ = physics.load_mjx(scene)
    blank = mjx.make_data(scene.lean)

    def step(qpos, qvel, force):
        data = mjx.step(model, blank.replace(qpos=qpos, qvel=qvel, qfrc_applied=force))
        return data.qpos, data.qvel

    return step


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.long
def test_left_out_phases_are_nothing(body: Any):
    """Each step from where `mjx.step` was: what differs is rounding, 3e-6 m/s and 3e-4 rad/s at 100
    rad/s.
    """
    scene = load_scene(SimConfig(body=body))
    ours, theirs = (
        jax.jit(jax.vmap(step)) for step in (physics.build_physics(scene), whole_step(scene))
    )
    qpos, qvel, force = states(scene)
    for _ in range(STEPS):
        got, expected = split(*ours(qpos, qvel, force)), theirs(qpos, qvel, force)
        wanted = split(*expected)
        np.testing.assert_allclose(got.position, wanted.position, atol=3e-6)
        np.testing.assert_allclose(got.quaternion, wanted.quaternion, atol=3e-6)
        np.testing.assert_allclose(got.velocity, wanted.velocity, atol=1e-5)
        np.testing.assert_allclose(got.rate, wanted.rate, atol=1e-3)
        qpos, qvel = expected


@pytest.mark.parametrize("body", BODIES)
def test_mass_matrix_is_the_same_in_every_pose(body: Any):
    scene = load_scene(SimConfig(body=body))
    mjx, model, level = physics.load_mjx(scene)
    matrix = lambda qpos: mjx.full_m(model, mjx.fwd_position(model, level.replace(qpos=qpos)))
    found = jax.jit(jax.vmap(matrix))(states(scene)[0])
    mass = np.concatenate(
        [(m, m, m, *inertia) for m, inertia in zip(scene.mass, scene.inertia, strict=True)]
    )
    np.testing.assert_allclose(found, np.broadcast_to(np.diag(mass), found.shape), rtol=3e-6)


@pytest.mark.long
def test_axes_that_are_not_the_bodys_leave_the_pose_out_as_well(tmp_path: Path):
    """A drone made of geoms: its inertia has a product xz of a tenth of what it is about y."""
    scene = load_scene(SimConfig(mjcf=str(write(tmp_path, BIG))))
    ours, theirs = (
        jax.jit(jax.vmap(step)) for step in (physics.build_physics(scene), whole_step(scene))
    )
    qpos, qvel, force = states(scene)
    force.reshape(FLIGHTS, 2, 6)[..., 3:] *= 100.0
    got, wanted = split(*ours(qpos, qvel, force)), split(*theirs(qpos, qvel, force))
    np.testing.assert_allclose(got.velocity, wanted.velocity, atol=1e-5)
    np.testing.assert_allclose(got.rate, wanted.rate, atol=1e-3)
    np.testing.assert_allclose(got.quaternion, wanted.quaternion, atol=3e-6)
