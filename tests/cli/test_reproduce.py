"""`dronecombat reproduce`: its plan, what it goes on with, where it stops; the steps are replaced."""

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from dronecombat_jax.cli import commands as cli
from dronecombat_jax.cli import reproduction
from dronecombat_jax.config import costs
from dronecombat_jax.errors import EXIT_CANNOT_WRITE, EXIT_CONFIG, EXIT_STOPPED
from dronecombat_jax.report import tournament_report

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


def test_another_device_may_go_on(work):
    assert cli.main(["reproduce", "--scale", "smoke"]) == EXIT_STOPPED
    assert cli.main(["reproduce", "--scale", "smoke", "--device", "cpu"]) == 0
    assert work == [*STEPS[:2], *STEPS[1:]]


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


def test_two_at_once_are_refused(work, capsys):
    with reproduction.claimed(FOLDER):
        assert cli.main(["reproduce", "--scale", "smoke"]) == EXIT_CANNOT_WRITE
    assert work == [] and "in use by process" in capsys.readouterr().err


def test_a_folder_that_cannot_be_made_is_one_line(work, capsys):
    FOLDER.parent.touch()
    assert cli.main(["reproduce", "--scale", "smoke"]) == EXIT_CANNOT_WRITE
    assert work == [] and capsys.readouterr().err.startswith("error: cannot write")


def test_what_a_killed_report_left_half_written_goes(monkeypatch, tmp_path):
    report = tmp_path / "report"
    (report / "tables").mkdir(parents=True)
    for half in (report / ".tmp-report.html-1-a", report / "tables" / ".tmp-x.csv-1-a"):
        half.touch()
    (report / "report.html").touch()
    # the report itself needs JAX, and is replaced
    monkeypatch.setitem(
        sys.modules, "dronecombat_jax.watch.pairs", SimpleNamespace(fights_page=print)
    )
    monkeypatch.setattr(tournament_report, "report", lambda *_: 0)
    assert reproduction._report(tmp_path) == 0
    assert [path.name for path in report.rglob("*") if path.is_file()] == ["report.html"]
