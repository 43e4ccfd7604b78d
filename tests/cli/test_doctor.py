"""The table of `dronecombat doctor`: every check is run, and what fails comes with a remedy."""

from dataclasses import replace

import jax
import pytest
from drones import BIG, SMALL, write

from dronecombat_jax.cli import doctor
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.machine import backend, rendering
from dronecombat_jax.sim import side_by_side


@pytest.mark.long
def test_doctor_passes_here_but_for_what_is_missing(capsys):
    expected = EXIT_CONFIG if rendering.fault() else 0
    assert doctor.doctor() == expected
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines if " FAIL " in line] == ["rendering"] * (
        expected != 0
    )


def test_doctor_goes_on_after_a_broken_check(monkeypatch, capsys):
    def broken() -> str:
        raise RuntimeError("the driver\nis gone")

    monkeypatch.setattr(doctor, "_physics", broken)
    assert doctor.doctor() == EXIT_CONFIG
    out = capsys.readouterr().out
    assert "physics      FAIL  RuntimeError: the driver is gone\n             fix:" in out
    assert "cache        ok" in out


def test_doctor_says_what_keeps_jax_from_starting(monkeypatch, capsys):
    monkeypatch.setattr(jax, "devices", lambda: (_ for _ in ()).throw(AssertionError()))
    monkeypatch.setenv("JAX_PLATFORMS", "cuda")
    monkeypatch.setattr(backend, "prepare", lambda: None)
    assert doctor.doctor() == EXIT_CONFIG
    lines = capsys.readouterr().out.splitlines()
    failed = [line for line in lines if " FAIL " in line]
    assert [line.split()[0] for line in failed] == ["devices", "physics"]
    assert all(
        "JAX does not start with JAX_PLATFORMS='cuda' (there is no such device" in line
        for line in failed
    )


@pytest.mark.long
def test_doctor_names_a_known_bad_jax_and_its_remedy(monkeypatch, capsys):
    def refused() -> None:
        raise UserError("jax 0.10.2 cannot be used: wrong numbers. Fix: pip install jax==0.9.2")

    monkeypatch.setattr(backend, "prepare", refused)
    assert doctor.doctor() == EXIT_CONFIG
    out = capsys.readouterr().out
    assert "jax          FAIL  jax 0.10.2 cannot be used: wrong numbers.\n" in out
    assert "fix:  pip install jax==0.9.2\n" in out


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            SMALL,
            (
                "mass         0.027 kg, weight 0.2649 N in a gravity of 9.81 m/s^2",
                "inertia      (2.395e-05, 2.395e-05, 3.235e-05) kg m^2",
                "thrust       0 to 0.5033 N along body z",
                "moments      up to 0.01 N m about the body's axes (sim.moment_scale): (417.5, 417.5, 309.1) rad/s^2",
                "fluid        density 1.225 kg/m^3, viscosity 1.8e-05 Pa s",
                "actuators body_thrust, x_moment, y_moment, z_moment (thrust and moments are the game's)",
                "contacts (the game has none)",
                "rotors       none: four alike actuators along body z would be",
                "1 sensors; 1 keyframes; the world around the drone",
            ),
        ),
        (
            BIG,
            (
                "mass         1.325 kg, weight 13 N",
                "products xy, xz, yz (0, -0.0021, 0)",
                "position     of its centre of mass, (0, 0, 0.05396) m from the body's origin",
                "a larger sim.moment_scale turns it faster",
                "rotors       four, 0 to 13 N each, 0.02 m torque per thrust, no lag: a TOML must say lag_up",
            ),
        ),
    ],
)
@pytest.mark.long
def test_doctor_says_how_a_drones_file_is_flown(text, words, tmp_path, capsys):
    file = write(tmp_path, text)
    assert doctor.doctor_mjcf(str(file)) == 0
    out = capsys.readouterr().out
    for word in (f"{file}: one drone", *words, "verdict      ok"):
        assert word in out
    assert out.count("side by side ") == 2 and "from C MuJoCo's `implicit`" in out


def test_doctor_says_why_a_drones_file_cannot_be_flown(tmp_path, capsys):
    file = write(tmp_path, SMALL, ("<freejoint/>", '<joint type="free" damping="1"/>'))
    assert doctor.doctor_mjcf(str(file)) == EXIT_CONFIG
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith(
        f"file         FAIL  sim.mjcf: {file}: cannot be flown as written: the free joint of body small"
    )


@pytest.mark.long
def test_doctor_fails_where_the_flights_part(tmp_path, capsys, monkeypatch):
    """As if the game left the fluid out."""
    plain = side_by_side.build_step

    def still(sim, scene):
        flown = replace(scene.flown, density=0.0, viscosity=0.0)
        return plain(sim, replace(scene, flown=flown))

    monkeypatch.setattr(side_by_side, "build_step", still)
    assert doctor.doctor_mjcf(str(write(tmp_path))) == EXIT_CONFIG
    out = capsys.readouterr().out
    assert "at most 0.01 m and 0.05 rad/s are right" in out and "verdict      FAIL" in out
