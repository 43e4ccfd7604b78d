"""`dronecombat play`: which words name the opponent, which are flags; the page is not written."""

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from dronecombat_jax import machine, watch
from dronecombat_jax.cli import commands as cli
from dronecombat_jax.errors import EXIT_CONFIG

DEFAULTS = {"side": "", "run_seed": -1, "out": None, "browser": False}


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list:
    """What the command asked for."""
    calls: list = []

    def play(words: tuple[str, ...], **how) -> int:
        calls.append((words, how))
        return 5

    for package, name, module in (
        (machine, "backend", SimpleNamespace(prepare=lambda *args: None, cores=lambda: 1)),
        (watch, "play", SimpleNamespace(play=play)),
    ):
        monkeypatch.setitem(sys.modules, f"{package.__name__}.{name}", module)
        monkeypatch.setattr(package, name, module, raising=False)
    return calls


@pytest.mark.parametrize(
    ("args", "words", "how"),
    [
        ("", (), {}),
        ("ippo:12 --side defender", ("ippo:12",), {"side": "defender"}),
        ("--open scripted:dash", ("scripted:dash",), {"browser": True}),
        ("a.safetensors --out x.html --run-seed=4", ("a.safetensors",),
         {"out": Path("x.html"), "run_seed": 4}),
    ],
)  # fmt: skip
def test_words_and_flags(asked: list, args: str, words: tuple[str, ...], how: dict):
    assert cli.main(["play", *args.split()]) == 5
    assert asked == [(words, DEFAULTS | how)]


@pytest.mark.parametrize(
    ("args", "message"),
    [
        ("ippo --side both", "--side"),
        ("ippo --sides attacker", "did you mean --side?"),
        ("ippo --out", "--out"),
    ],
)
def test_mistakes_are_named_before_anything_is_read(asked: list, args: str, message: str, capsys):
    assert cli.main(["play", *args.split()]) == EXIT_CONFIG and asked == []
    err = capsys.readouterr().err
    assert message in err and all(line.startswith("error: ") for line in err.splitlines())


def test_help_has_an_example(capsys):
    assert cli.main(["play", "--help"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "dronecombat play ippo:12 --side defender" in text.replace("│ ", "")
