"""The table of `dronecombat doctor`: every check is run, and what fails comes with a remedy."""

from dronecombat_jax import backend, doctor
from dronecombat_jax.errors import EXIT_CONFIG, UserError


def test_doctor_passes_here_but_for_what_is_missing(capsys):
    expected = EXIT_CONFIG if backend.rendering_fault() else 0
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


def test_doctor_names_a_known_bad_jax_and_its_remedy(monkeypatch, capsys):
    def refused() -> None:
        raise UserError("jax 0.10.2 cannot be used: wrong numbers. Fix: pip install jax==0.9.2")

    monkeypatch.setattr(backend, "prepare", refused)
    assert doctor.doctor() == EXIT_CONFIG
    out = capsys.readouterr().out
    assert "jax          FAIL  jax 0.10.2 cannot be used: wrong numbers.\n" in out
    assert "fix:  pip install jax==0.9.2\n" in out
