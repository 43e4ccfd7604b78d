"""The program around the commands: usage, help, errors, and how it starts."""

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest
from refusals import refused

from dronecombat_jax import arena, report, runs, tournaments, watch
from dronecombat_jax.cli import commands as cli
from dronecombat_jax.config import flags, settings
from dronecombat_jax.config.setting import setting
from dronecombat_jax.errors import EXIT_CONFIG, UserError

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("args", [["--help"], ["-h"], ["help"]])
def test_help_lists_every_command(capsys, args):
    assert cli.main(args) == 0
    out = capsys.readouterr().out
    for name, command in cli.COMMANDS.items():
        assert f"  {name} " in out and (command.__doc__ or "?") in out


def test_without_a_command_the_usage_is_shown(capsys):
    assert cli.main([]) == EXIT_CONFIG
    assert "usage: dronecombat COMMAND" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("word", "hint"), [("trian", "did you mean train?"), ("zzz", "commands: train, evaluate, "), ("--seed", "commands")]
)  # fmt: skip
def test_an_unknown_command(capsys, word, hint):
    (line,) = refused(capsys, word)
    assert line.startswith(f"{word}: unknown command; ") and hint in line


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_every_command_has_help_with_an_example_whose_flags_exist(capsys, command):
    assert cli.main([command, "--help"]) == 0
    out = capsys.readouterr().out
    assert f"usage: dronecombat {command}" in out
    examples = re.findall(rf"^    (dronecombat {command}\b.*)$", out, re.MULTILINE)
    assert examples, "no example"
    for flag in re.findall(r"--[a-z_.-]+", "\n".join(examples)):
        assert re.search(rf"^  .*{flag}\b", out, re.MULTILINE), flag


def test_help_of_train_has_every_setting_with_its_words(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    assert cli.main(["train", "--help"]) == 0
    out = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for key, entry in settings.SCHEMA.items():
        assert settings.flag(key) in out and entry.explained in out
    assert "physics step [s, from 0.0001 to 0.05] (default: 0.01)" in out


def test_a_command_is_one_function_and_one_line(monkeypatch, capsys):
    @dataclass(frozen=True)
    class GreetFlags:
        """Say hello."""

        times: int = setting(1, "how often", low=1, high=3)

    def greet(args) -> int:
        """say hello"""
        print("hello " * flags.read(GreetFlags, args, "dronecombat greet").times)
        return 0

    monkeypatch.setitem(cli.COMMANDS, "greet", greet)
    assert cli.main(["greet", "--times", "2"]) == 0
    assert capsys.readouterr().out == "hello hello \n"
    assert refused(capsys, "greet", "--times", "4") == ["--times 4: must be an integer from 1 to 3"]


def test_errors_from_inside_a_command_keep_their_code(rooms, capsys):
    def broken(config):
        raise UserError("runs/mine: cannot be written", 73)

    rooms.stand_in(runs, "training", train=broken)
    assert cli.main(["train"]) == 73
    assert capsys.readouterr().err == "error: runs/mine: cannot be written\n"


def test_an_interrupt_is_no_traceback(rooms, capsys):
    def interrupted(config):
        raise KeyboardInterrupt

    rooms.stand_in(runs, "training", train=interrupted)
    assert cli.main(["train"]) == 130
    assert capsys.readouterr().err == "stopped\n"


def program(*args: str, **kwargs) -> subprocess.CompletedProcess:
    """Run Python with the checkout importable."""
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    return subprocess.run(
        [sys.executable, *args], env=environment, capture_output=True, text=True, **kwargs
    )


@pytest.mark.parametrize(
    "args", [["--help"], ["train", "--help"], ["evaluate", "--help"], ["train", "--seed", "x"], ["train", "--print-config"]]
)  # fmt: skip
def test_help_and_bad_input_import_neither_jax_nor_mujoco(args):
    code = (
        "import sys; from dronecombat_jax.cli.commands import main; main(sys.argv[1:]);"
        "sys.stderr.write(f\"heavy: {sorted({'jax', 'mujoco', 'flax', 'numpy', 'matplotlib'} & sys.modules.keys())}\")"
    )
    assert program("-c", code, *args).stderr.endswith("heavy: []")


@pytest.mark.parametrize("module", ["dronecombat_jax", "dronecombat_jax.cli.commands"])
def test_runs_as_a_module(module):
    result = program("-m", module, "train", "--seed", "x")
    assert (result.returncode, result.stdout) == (EXIT_CONFIG, "")
    assert result.stderr == "error: --train.seed x: must be an integer from 0 to 2147483647\n"


def test_a_reader_that_leaves_is_no_traceback():
    reading, writing = os.pipe()
    os.close(reading)
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    command = [sys.executable, "-m", "dronecombat_jax", "train", "--print-config"]
    result = subprocess.run(
        command, env=environment, stdout=writing, stderr=subprocess.PIPE, text=True
    )
    os.close(writing)
    assert "Traceback" not in result.stderr and "Exception" not in result.stderr


def test_robustness_hands_over_its_words_and_draws_what_was_written(rooms, capsys):
    calls, report_of = rooms.calls, {}
    say = lambda name, given: lambda *args, **how: calls.append((name, args, how)) or given
    planned = SimpleNamespace(path=Path("there"))
    fly = lambda planned, **how: calls.append(("fly", how)) or (5, report_of)
    rooms.stand_in(
        tournaments, "robustness", plan=say("plan", planned), robustness=fly, FOLDER="r", FILE="f"
    )
    rooms.stand_in(report, "figures", save_figure=say("save", None))
    rooms.stand_in(report, "robustness_figure", robustness_figure=say("draw", "figure"))
    assert (
        cli.main(["robustness", "a", "b", "--episodes", "7", "--gaps", "lag,drag", "--together"])
        == 5
    )
    assert [call[0] for call in calls] == ["prepare", "plan", "fly"]
    assert calls[1][1] == (["a", "b"],) and calls[1][2]["episodes"] == 7
    assert calls[2][1] == {
        "gaps": "lag,drag",
        "together": True,
        "skip_bad": False,
        "allow_mismatch": False,
    }
    report_of["rows"] = []
    assert cli.main(["robustness", "mine"]) == 5
    assert calls[-1] == ("save", ("figure", Path("there/r/robustness.png")), {})
    assert "robustness.png" in capsys.readouterr().out
    assert refused(capsys, "robustness", "--together")[0].startswith("nobody is named")


def test_report_and_compare_hand_over_their_words(rooms, capsys):
    calls = rooms.calls
    say = lambda name: lambda *args, **kwargs: calls.append((name, args, kwargs)) or 0
    rooms.stand_in(report, "tournament_report", report=say("report"))
    rooms.stand_in(watch, "pairs", fights_page=say("page"))
    rooms.stand_in(tournaments, "comparison", compare=say("compare"))
    rooms.stand_in(arena, "rectangle", Rules=lambda *rules: rules)
    assert cli.main(["report", "joint", "--out", "there"]) == 0
    assert cli.main(["compare", "a", "b", "--by", "preset", "c", "--episodes", "7"]) == 0
    assert [call[0] for call in calls] == ["prepare", "report", "prepare", "compare"]
    assert calls[1][1][:2] == ("joint", Path("there")) and callable(calls[1][1][2])
    _, (words, rules), options = calls[3]
    assert words == ["a", "b", "c"] and rules == (7, 0, False)
    assert (options["by"], options["every"], options["name"]) == ("preset", 10, "")
    assert refused(capsys, "compare", "a", "--bye", "x")[0].startswith("--bye: unknown flag")
