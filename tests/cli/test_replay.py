"""`dronecombat replay`: which words name players, which are flags; the flying is replaced."""

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from dronecombat_jax import machine, watch
from dronecombat_jax.cli import commands as cli
from dronecombat_jax.errors import EXIT_CONFIG
from dronecombat_jax.watch.flyers import Named
from dronecombat_jax.watch.recording import Filming

DEFAULTS = {"out": None, "evolution": False, "browser": False}


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list:
    """What the command asked for: who, which fights, and the rest."""
    calls: list = []

    def replay(named: Named, filming: Filming, **how) -> int:
        calls.append((named, filming, how))
        return 5

    for package, name, module in (
        (machine, "backend", SimpleNamespace(prepare=lambda *args: None, cores=lambda: 1)),
        (watch, "replay", SimpleNamespace(replay=replay)),
    ):
        monkeypatch.setitem(sys.modules, f"{package.__name__}.{name}", module)
        monkeypatch.setattr(package, name, module, raising=False)
    return calls


@pytest.mark.parametrize(
    ("args", "named", "filming", "how"),
    [
        ("", Named(), Filming(), {}),
        ("ippo --defender 5 --attacker dash", Named(("ippo",), ("5", "dash")), Filming(), {}),
        ("--evolution ippo --open", Named(("ippo",)), Filming(), {"evolution": True, "browser": True}),
        ("a.safetensors --seed 3 --fights=2 b.safetensors --stochastic --spawn fixed --out x.gif",
         Named(("a.safetensors", "b.safetensors")), Filming(2, 3, True, "fixed"), {"out": Path("x.gif")}),
        ("ippo --run-seed 4 --allow-env-mismatch", Named(("ippo",), run_seed=4, allow_mismatch=True), Filming(), {}),
    ],
)  # fmt: skip
def test_words_and_flags(asked: list, args: str, named: Named, filming: Filming, how: dict):
    assert cli.main(["replay", *args.split()]) == 5
    assert asked == [(named, filming, DEFAULTS | how)]


@pytest.mark.parametrize(
    ("args", "message"),
    [
        ("ippo --fights 17", "--fights"),
        ("ippo --fight 3", "did you mean --fights?"),
        ("ippo --defender", "--defender"),
        ("ippo --spawn nowhere", "--spawn"),
    ],
)
def test_mistakes_are_named_before_anything_is_read(asked: list, args: str, message: str, capsys):
    assert cli.main(["replay", *args.split()]) == EXIT_CONFIG and asked == []
    err = capsys.readouterr().err
    assert message in err and all(line.startswith("error: ") for line in err.splitlines())


def test_help_has_an_example(capsys):
    assert cli.main(["replay", "--help"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "dronecombat replay ippo --evolution" in text.replace("│ ", "") and "--fights" in text
