"""The table of `dronecombat doctor`: every check is run, and what fails comes with a remedy."""

import jax

from dronecombat_jax import backend, doctor, rendering
from dronecombat_jax.errors import EXIT_CONFIG, UserError


def test_doctor_passes_here_but_for_what_is_missing(capsys):
    expected = EXIT_CONFIG if rendering.fault() else 0
    assert doctor.doctor() == expected
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines if " FAIL " in line] == ["rendering"] * (expected != 0)


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
    assert all("JAX does not start with JAX_PLATFORMS='cuda' (there is no such device" in line for line in failed)


def test_doctor_names_a_known_bad_jax_and_its_remedy(monkeypatch, capsys):
    def refused() -> None:
        raise UserError("jax 0.10.2 cannot be used: wrong numbers. Fix: pip install jax==0.9.2")

    monkeypatch.setattr(backend, "prepare", refused)
    assert doctor.doctor() == EXIT_CONFIG
    out = capsys.readouterr().out
    assert "jax          FAIL  jax 0.10.2 cannot be used: wrong numbers.\n" in out
    assert "fix:  pip install jax==0.9.2\n" in out
