"""The wheel as its user has it: an empty environment, another directory, no checkout in reach."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
Run = Callable[..., str]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """`run(words)`: a command of the environment in a folder of its own, which must succeed."""
    folder = tmp_path_factory.mktemp("walk")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    subprocess.run([sys.executable, "-m", "venv", folder / "venv"], check=True)
    python = folder / "venv" / "bin" / "python"
    pins = ["-c", str(ROOT / "constraints.txt")]
    install = [python, "-m", "pip", "install", "--disable-pip-version-check", "-q", *pins, wheel]
    made = subprocess.run(install, capture_output=True, text=True)
    if made.returncode and "No matching distribution" in made.stderr:
        pytest.skip(f"no packages can be had here: {made.stderr.splitlines()[-1]}")
    assert made.returncode == 0, made.stderr
    place = folder / "elsewhere"
    place.mkdir()
    kept = {name: os.environ[name] for name in ("PATH", "HOME", "LANG") if name in os.environ}

    def run(*words: str) -> str:
        command = [str(python.with_name("dronecombat")), *words]
        environment = {**kept, "XDG_CACHE_HOME": str(folder / "cache")}
        done = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    run.place = place  # pyright: ignore[reportFunctionMemberAccess]
    return run


@pytest.mark.slow
def test_a_fight_of_shipped_pilots_then_a_training_and_its_replay(run: Run):
    place: Path = run.place  # pyright: ignore[reportFunctionMemberAccess]
    shown = run("replay")
    assert re.search(r"league-defender-\d+ defends against strong-attacker-\d+", shown)
    assert (place / "replay.html").stat().st_size < 1.5e6
    run("train", "--preset", "smoke", "--name", "first", "--run.no-video")
    assert "first" in run("replay", "first", "--fights", "2")
    assert (place / "runs" / "first" / "replay.html").is_file()
    assert "ippo-attacker" in run("pilots")
    rated = run("rate", "pilots:ippo-attacker", "--fights", "2").splitlines()[-2:]
    assert re.match(r"attacker ippo-attacker-\d+: rating 1\d+\.\d, .* of 46$", rated[0])
    assert re.search(r"first +finished .* 100 %", run("runs"))
