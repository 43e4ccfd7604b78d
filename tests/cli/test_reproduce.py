"""`dronecombat reproduce`: its plan, what it goes on with, where it stops; the steps are replaced."""

import json
from pathlib import Path

import pytest

from dronecombat_jax.cli import commands as cli
from dronecombat_jax.cli import reproduction
from dronecombat_jax.config import costs
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_STOPPED

FOLDER = Path("reproductions/smoke")
STEPS = ["train ippo", "train sippo", "tournament", "report"]


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch, rooms) -> list[str]:
    """The steps that were entered; each leaves its output, and one of `stops` ends with 75."""
    entered: list[str] = []
    real = reproduction.steps_of

    def steps_of(*args):
        def enter(step):
            def work() -> int:
                entered.append(step.name)
                if entered == ["train ippo", "train sippo"]:
                    return EXIT_STOPPED
                step.output.parent.mkdir(parents=True, exist_ok=True)
                step.output.touch()
                return 0

            return work

        return [step._replace(work=enter(step)) for step in real(*args)]

    monkeypatch.setattr(reproduction, "steps_of", steps_of)
    monkeypatch.setattr(costs, "measured_gflops", lambda cores: 100.0)
    return entered


def test_the_same_command_goes_on_and_does_nothing_twice(work, capsys):
    command = ["reproduce", "--scale", "smoke"]
    assert cli.main(command) == EXIT_STOPPED
    assert work == STEPS[:2]
    assert "0 of 4 steps are finished" in capsys.readouterr().out
    assert cli.main(command) == 0
    assert work == [*STEPS[:2], *STEPS[1:]]
    told = capsys.readouterr().out
    assert "1 of 4 steps are finished" in told and "train ippo:" not in told
    assert "finished: reproductions/smoke/tournaments/all/report/report.html" in told
    assert cli.main(command) == 0
    assert len(work) == 5 and "4 of 4 steps are finished" in capsys.readouterr().out


def test_what_has_gone_or_was_made_by_other_settings_is_done_again(work):
    command = ["reproduce", "--scale", "smoke"]
    cli.main(command)
    cli.main(command)
    work[:] = ["all"]
    (FOLDER / "tournaments/all/report/report.html").unlink()
    assert cli.main(command) == 0 and work == ["all", "report"]
    noted = FOLDER / reproduction.FINISHED_NAME
    noted.write_text(json.dumps({**json.loads(noted.read_text()), "tournament": "older"}))
    assert cli.main(command) == 0 and work == ["all", "report", "tournament"]
    noted.write_text("damaged")
    assert cli.main(command) == 0 and work[3:] == STEPS


def test_an_estimate_is_said_and_nothing_done(work, capsys):
    assert cli.main(["reproduce", "--scale", "paper", "--estimate"]) == 0
    told = capsys.readouterr().out
    assert work == [] and not FOLDER.parent.exists()
    assert "16.01 G steps in all" in told and "memory" in told and "disk" in told


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--scale", "huge"], "smoke, laptop, gpu, paper"),
        (["--preset", "dule"], "did you mean duel?"),
        (["--name", "../up"], "is not allowed"),
        (["--scales", "smoke"], "did you mean --scale?"),
    ],
)
def test_mistakes_are_one_line(work, args, message, capsys):
    assert cli.main(["reproduce", *args]) == EXIT_CONFIG and work == []
    err = capsys.readouterr().err
    assert message in err and all(line.startswith("error: ") for line in err.splitlines())
