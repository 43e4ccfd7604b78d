"""The second learner of best responses: a result of the same form as that of `dronecombat exploit`."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from saved_runs import TOY, write_run

SCRIPT = Path(__file__).resolve().parents[2] / "experiments" / "brax_response.py"


def command(run: Path, *flags: str) -> subprocess.CompletedProcess[str]:
    words = [sys.executable, str(SCRIPT), str(run), *flags]
    return subprocess.run(words, capture_output=True, text=True)


@pytest.mark.slow
def test_braxs_ppo_responds_to_the_attacker_of_a_run(tmp_path):
    run = write_run(tmp_path / "old", TOY)
    steps = 2 * TOY.steps_per_iteration
    flags = ("--role", "attacker", "--steps", str(steps), "--restarts", "2", "--fights", "16")
    done = command(run, *flags)
    assert done.returncode == 0, done.stderr
    assert "brax's ppo: attacker of old: the best of 2 responders wins " in done.stdout
    (file,) = (run / "exploit").glob("*.json")
    result = json.loads(file.read_text())
    assert file.name == "attacker-3-x2-brax.json" and file.with_suffix(".png").is_file()
    assert (result["learner"], result["restarts"], result["fights"]) == ("brax ppo", 2, 16)
    assert result["curve"][-1]["steps"] >= steps
    assert all(0.0 <= share <= 1.0 for row in result["curve"] for share in row["chosen_by"])


@pytest.mark.slow
def test_a_pilot_of_the_package_sees_what_it_saw_in_its_training(tmp_path):
    words = [sys.executable, str(SCRIPT), "pilots:strong-defender-67", "--preset", "responder"]
    words += ["--steps", "1e4", "--restarts", "1", "--fights", "16"]
    done = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (file,) = (tmp_path / "runs" / "exploit").glob("*-brax.json")
    assert json.loads(file.read_text())["of"] == "pilots:strong-defender-67"


@pytest.mark.slow
def test_a_run_that_is_not_there_is_one_line(tmp_path):
    done = command(tmp_path / "none")
    assert done.returncode == 3 and done.stderr.count("\n") == 1 and "no such run" in done.stderr
