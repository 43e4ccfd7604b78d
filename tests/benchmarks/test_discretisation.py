"""What the time step loses: the exact reference by formulas, the losses by their known size."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.discretisation import (
    ALTITUDE,
    Flight,
    c_mujoco,
    exact,
    gentle,
    ours,
    shares_kept,
    spread,
    tumbles,
)
from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.sim.scene import load_scene

SIM = SimConfig()
HALF = SimConfig(timestep=0.005, substeps=4)
G = 9.81


def test_the_exact_tumble_keeps_energy_and_momentum():
    flights = tumbles(SIM, 20.0, 1.0, 3)
    kept = shares_kept(SIM, flights, [exact(SIM, one) for one in flights], 1.0)
    np.testing.assert_allclose(kept, 1.0, atol=1e-8)


def test_the_exact_rise_and_spin_by_their_formulas():
    # Full thrust: 0.9 g upwards. A moment of 0.01 N m about z, a principal axis: 0.01 t / I.
    action = np.tile((1.0, 0.0, 0.0, 0.001), (50, 1))
    path = exact(SIM, Flight(np.zeros(3), action))
    time = 0.02 * np.arange(1, 51)
    height, inertia = ALTITUDE + 0.9 * G * time**2 / 2, load_scene(SIM).inertia[0, 2]
    np.testing.assert_allclose(path.position[:, 2], height, rtol=1e-9)
    np.testing.assert_allclose(path.rate[:, 2], 0.001 * 0.01 / inertia * time, rtol=1e-9)


def test_the_exact_dash_is_where_c_mujoco_goes_with_ever_smaller_steps():
    _, dash = gentle(SIM)
    ends = []
    for timestep in (0.0002, 0.0001):
        fine = SimConfig(timestep=timestep, substeps=round(0.02 / timestep))
        ends.append(c_mujoco(fine, dash).position[-1])
    limit = 2 * ends[1] - ends[0]  # the error is linear in the step
    np.testing.assert_allclose(limit, exact(SIM, dash).position[-1], atol=1e-6)


@pytest.fixture(scope="module", params=[SIM, HALF], ids=["step", "half"])
def flown(request: pytest.FixtureRequest) -> SimpleNamespace:
    """Four tumbles and both gentle flights of 1 s: ours (one program), in C MuJoCo, exactly."""
    sim = request.param
    flights = [*tumbles(sim, 20.0, 1.0, 4), *gentle(sim)]
    theirs, truth = ([fly(sim, one) for one in flights] for fly in (c_mujoco, exact))
    fast = ours(sim, flights)
    return SimpleNamespace(sim=sim, flights=flights, ours=fast, theirs=theirs, exact=truth)


@pytest.mark.long
def test_a_drone_that_rises_is_ahead_by_half_a_step_of_its_speed(flown: SimpleNamespace):
    # Euler with the new velocity: h^2 a n (n + 1) / 2 instead of h^2 a n^2 / 2; h a t / 2 too far.
    ahead = flown.sim.timestep * 0.9 * G / 2
    for path in (flown.ours[4], flown.theirs[4]):
        apart = path.position[-1] - flown.exact[4].position[-1]
        np.testing.assert_allclose(apart, [0, 0, ahead], atol=2e-5)
    apart = np.linalg.norm(flown.ours[5].position[-1] - flown.exact[5].position[-1])
    assert apart == pytest.approx(5.04 * flown.sim.timestep, rel=0.02)  # the dash: linear, too


@pytest.mark.long
def test_tumbling_loses_what_c_mujoco_loses_and_less_with_half_the_step(flown: SimpleNamespace):
    kept = lambda paths: shares_kept(flown.sim, flown.flights[:4], paths[:4], 1.0)
    np.testing.assert_allclose(kept(flown.ours), kept(flown.theirs), atol=1e-3)
    lost = 1 - kept(flown.ours)[:, 0].mean()
    least, most = {0.01: (0.10, 0.20), 0.005: (0.05, 0.10)}[flown.sim.timestep]
    assert least < lost < most


def test_a_range_is_shown_where_there_is_one():
    assert spread(np.array([0.5, 0.7])) == "0.600 [0.500, 0.700]"
    assert spread(np.array([1.0, 1.0 - 1e-9])) == "1.000"
