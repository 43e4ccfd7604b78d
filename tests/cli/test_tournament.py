"""`dronecombat tournament`: which words are entrants and which belong to flags; the tournament
itself is replaced.
"""

import sys
from types import SimpleNamespace

import pytest

from dronecombat_jax import machine, tournaments
from dronecombat_jax.arena.rectangle import Rules
from dronecombat_jax.cli import commands as cli
from dronecombat_jax.errors import EXIT_CONFIG

DEFAULTS = {
    "name": "",
    "every": 1,
    "untrained": False,
    "flights": 0,
    "spawn": "as_trained",
    "mjcf": "",
    "skip_bad": False,
    "allow_mismatch": False,
}


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list:
    """What the command asked of the tournament: words, rules and the rest."""
    calls: list = []

    def tournament(words: list[str], rules: Rules, **how) -> int:
        calls.append((words, rules, how))
        return 5

    for package, name, module in (
        (machine, "backend", SimpleNamespace(prepare=lambda *args: None, cores=lambda: 1)),
        (tournaments, "tournament", SimpleNamespace(tournament=tournament)),
    ):
        monkeypatch.setitem(sys.modules, f"{package.__name__}.{name}", module)
        monkeypatch.setattr(package, name, module, raising=False)
    return calls


@pytest.mark.parametrize(
    ("args", "words", "rules", "how"),
    [
        ("ippo sippo scripted:all", ["ippo", "sippo", "scripted:all"], Rules(), {}),
        ("--episodes 7 ippo --seed=3 x.safetensors --stochastic a", ["ippo", "x.safetensors", "a"], Rules(7, 3, True), {}),
        ("pilots:all --spawn even", ["pilots:all"], Rules(), {"spawn": "even"}),
        ("ippo --skip_bad --every 10 --name --allow-env-mismatch", None, None, None),
        ("--skip-bad ippo --every 10 --name mine b --allow-env-mismatch --untrained", ["ippo", "b"], Rules(),
         {"skip_bad": True, "every": 10, "name": "mine", "allow_mismatch": True, "untrained": True}),
    ],
)  # fmt: skip
def test_words_and_flags(asked: list, args: str, words, rules, how, capsys):
    code = cli.main(["tournament", *args.split()])
    if words is None:  # --name lacks its value
        assert code == EXIT_CONFIG and asked == [] and "--name" in capsys.readouterr().err
    else:
        assert code == 5 and asked == [(words, rules, DEFAULTS | how)]


@pytest.mark.parametrize(
    ("args", "message"),
    [
        ("", "nobody is named"),
        ("--episodes 5", "nobody is named"),
        ("ippo --episodes 0", "--episodes"),
        ("ippo --episode 3", "did you mean --episodes?"),
        ("ippo --stochastic=yes", "an on-off flag takes no value"),
    ],
)
def test_mistakes_are_named_before_anything_is_read(asked: list, args: str, message: str, capsys):
    assert cli.main(["tournament", *args.split()]) == EXIT_CONFIG and asked == []
    err = capsys.readouterr().err
    assert message in err and all(line.startswith("error: ") for line in err.splitlines())


def test_help_names_the_entrants(capsys):
    assert cli.main(["tournament", "--help"]) == 0
    told = capsys.readouterr().out
    assert "ENTRANTS" in told and "--skip-bad" in told and "scripted:all" in told
