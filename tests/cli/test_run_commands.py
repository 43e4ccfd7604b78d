"""Commands about a run that is there: flags, messages and exit codes; JAX is never imported."""

from pathlib import Path

import pytest
from refusals import refused

from dronecombat_jax.cli import commands as cli
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA, EXIT_STOPPED

# evaluate, doctor


def test_evaluate_takes_a_folder_or_a_name_in_runs(rooms, tmp_path):
    (tmp_path / "runs" / "mine").mkdir(parents=True)
    (tmp_path / "elsewhere").mkdir()
    assert cli.main(["evaluate", "mine"]) == 0
    assert (
        cli.main(
            [
                "evaluate",
                "elsewhere",
                "--fights",
                "3",
                "--chunk",
                "0",
                "--seed",
                "9",
                "--stochastic",
                "--defenders",
                "4",
                "--attackers",
                "2",
            ]
        )
        == 0
    )
    assert rooms.calls == [
        ("prepare", "auto", 1),
        ("evaluate", Path("runs/mine"), ("match", 0, 0, False, "", "", "", 0, 0), None),
        ("prepare", "auto", 1),
        ("evaluate", Path("elsewhere"), ("match", 3, 9, True, "", "", "", 4, 2), 0),
    ]


def test_evaluate_puts_a_scripted_pilot_in_one_place(rooms, tmp_path):
    (tmp_path / "runs" / "mine").mkdir(parents=True)
    assert cli.main(["evaluate", "mine", "--attacker", "dash", "--spawn", "fixed"]) == 0
    assert rooms.calls[1] == (
        "evaluate",
        Path("runs/mine"),
        ("match", 0, 0, False, "", "dash", "fixed", 0, 0),
        None,
    )


@pytest.mark.parametrize(
    ("args", "code", "message"),
    [
        ("", EXIT_CONFIG, "RUN is missing: a folder, or a name in runs/"),
        ("minr", EXIT_DATA, "minr: no such run; did you mean mine?"),
        ("zzzz", EXIT_DATA, "zzzz: no such run; runs there are: mine"),
        ("x" * 999, EXIT_DATA, "no such run"),
        ("mine --defenders 9", EXIT_CONFIG, "--defenders 9: must be an integer from 0 to 8"),
        ("mine --fights -1", EXIT_CONFIG, "--fights -1: must be an integer from 0 to 1000000"),
        ("mine --fights abc", EXIT_CONFIG, "--fights abc: must be an integer from 0 to 1000000"),
        ("mine --fight 3", EXIT_CONFIG, "--fight: unknown flag; did you mean --fights?"),
        ("mine other", EXIT_CONFIG, '"other": belongs to no flag'),
        ("mine\t", EXIT_CONFIG, "RUN: run = "),
    ],
)
def test_a_wrong_evaluation_is_one_line(rooms, capsys, tmp_path, args, code, message):
    (tmp_path / "runs" / "mine").mkdir(parents=True)
    (line,) = refused(capsys, "evaluate", *(args.split(" ") if args else ()), code=code)
    assert message in line
    assert rooms.calls == []


def test_doctor_gives_its_own_exit_code(rooms):
    assert cli.main(["doctor"]) == 2
    assert cli.main(["doctor", "--mjcf", "x2.xml"]) == 0
    assert rooms.calls == [("doctor",), ("doctor_mjcf", "x2.xml")]


# The program around the commands


# As a program


# exploit


def test_exploit_trains_responders_and_stops_with_their_training(rooms):
    from dronecombat_jax import runs

    def write_policy(plan) -> None:
        rooms.calls.append(("write_policy", plan.wanted.word))

    rooms.stand_in(runs, "exploit", write_policy=write_policy)
    words = [
        "exploit",
        "scripted:weave",
        "--role",
        "attacker",
        "--budget",
        "5e5",
        "--restarts",
        "2",
    ]
    assert cli.main(words) == EXIT_STOPPED
    prepared, written, (name, config) = rooms.calls
    assert prepared[0] == "prepare" and written == ("write_policy", "scripted:weave")
    assert name == "train" and config.selfplay.opponents == "attacker=scripted:weave"
    assert (config.train.total_steps, config.train.num_seeds) == (500_000, 2)


@pytest.mark.parametrize(
    ("args", "message"),
    [
        ("exploit", "RUN is missing"),
        ("exploit ippo --restarts 0", "--restarts 0: must be an integer from 1 to 1024"),
        ("exploit ippo --budget much", "--budget much: must be a number from 1"),
    ],
)
def test_a_wrong_exploit_is_one_line(rooms, capsys, args, message):
    (line,) = refused(capsys, *args.split())
    assert message in line and rooms.calls == []
