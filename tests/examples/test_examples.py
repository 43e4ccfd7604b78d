"""Every program in examples/ runs, and does what it says."""

import importlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dronecombat_jax import Config, load_run, train
from dronecombat_jax.cli import commands
from dronecombat_jax.config import settings
from dronecombat_jax.config.own import chosen
from dronecombat_jax.errors import UserError

EXAMPLES = Path(__file__).parents[2] / "examples"
SMALL = """
[train]
num_envs = 16
total_steps = 384
chunk_iterations = 2
[learn]
hidden_sizes = [8, 8]
rollout_steps = 6
epochs = 1
minibatches = 2
[game]
episode_steps = 20
[sim]
substeps = 1
[run]
figures = false
video = false
replay = false
evaluation_fights = 4
"""  # 4 iterations, 2 chunks


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch) -> None:
    """A folder for the runs, with the examples on the path, and a preset small enough for a test."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(EXAMPLES))
    Path("small.toml").write_text(SMALL)


def example(name: str):
    return importlib.import_module(name)


@pytest.mark.long
def test_roll_out():
    causes = example("roll_out").main(fights=50)
    assert sum(causes.values()) == 50 and causes["defender_crash"] + causes["attacker_crash"] > 0


@pytest.mark.tour
def test_train_rate_and_fly():
    share = example("train_from_python").main("small.toml")
    assert 0.0 <= share <= 1.0 and load_run("from-python").iteration == 4
    assert Path("runs/from-python/evaluation.json").is_file()
    how = {"role": "attacker", "fights": 1, "allow_env_mismatch": True}
    ratings = example("rate_your_policy").main("runs/from-python", **how)
    assert ratings.keys() == {"attacker"} and 0.0 < ratings["attacker"] < 1500.0
    assert commands.main(["export", "from-python", "a.safetensors", "--role", "attacker"]) == 0
    action = example("fly_exported").main("a.safetensors")
    assert action.shape == (4,) and np.all(np.abs(action) <= 1.0)


@pytest.mark.tour
@pytest.mark.parametrize("name", ["own_algorithm", "own_observation", "own_sampler", "own_reward"])
def test_parts_of_ones_own(name, capsys):
    example(name).main("small.toml")
    run = Path("runs") / name.replace("_", "-")
    saved = load_run(run)
    assert saved.iteration == 4 and f"{name}:" in (run / "config.toml").read_text()
    rows = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    assert len(rows) == 4
    if name == "own_observation":
        assert saved.combat.observation.size == 15
        assert saved.state.learners.parameters.policy.weights[0].shape[-2] == 15
        assert commands.main(["export", run.name, "a.safetensors"]) == 2
        assert "sees by own_observation:BEARINGS" in capsys.readouterr().err


def test_a_part_that_is_not_there_is_one_line():
    with pytest.raises(UserError, match="nowhere:x: no module nowhere here or among the packages"):
        chosen({}, "nowhere:x")
    with pytest.raises(UserError, match="own_sampler:zzz: own_sampler has no zzz"):
        chosen({}, "own_sampler:zzz")
    with pytest.raises(UserError, match=r"must be one of uniform.*or MODULE:NAME of your own"):
        settings.load("smoke", {"selfplay.sampler": "a b:c"})


def test_changes_of_whole_settings_are_refused_and_not_left_out():
    with pytest.raises(UserError, match="changes go with a preset's name"):
        train(Config(), {"train.seed": 3})


def test_an_error_inside_a_module_of_ones_own_is_its_own(tmp_path):
    (tmp_path / "broken_part.py").write_text("import math\nmath.no_such_thing\n")
    with pytest.raises(AttributeError, match="no_such_thing"):
        chosen({}, "broken_part:x")


def test_importing_the_package_starts_no_jax():
    code = (
        "import sys, dronecombat_jax as dc; dc.load_config('smoke'); dc.Config; dc.UserError;"
        "print(sorted({'jax', 'mujoco', 'numpy'} & sys.modules.keys()))"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout == "[]\n"
