"""Training as a user meets it: one command to begin, to go on after any end, and to be told what is
wrong.

The commands run in processes of their own, at toy size and compiled with little optimisation.
"""

import json
import signal
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from saved_runs import newest
from tiny import CHUNK, COMMAND, STEPS, finish, interrupt, kill_while_compiling
from tiny import train as begin

from dronecombat_jax.cli import commands as cli
from dronecombat_jax.config import estimates, settings
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_STOPPED
from dronecombat_jax.files import checkpoint, metrics
from dronecombat_jax.runs import training

CHUNKS = 16
LENGTH = ("--steps", str(CHUNKS * CHUNK * STEPS))


def train(root: Path, name: str, *flags: str):
    return begin(root, name, *LENGTH, *flags)


def digest(run: Path) -> str:
    return checkpoint.verify(run / "checkpoints", CHUNKS * CHUNK).digest


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> SimpleNamespace:
    """The run that nothing interrupts, begun by the command line."""
    root = tmp_path_factory.mktemp("runs")
    code, out, err = finish(train(root, "whole"))
    assert code == 0, err
    return SimpleNamespace(
        root=root, path=root / "whole", out=out, config=settings.load(root / "whole/config.toml")
    )


def test_a_training_leaves_its_files_and_complete_metrics(whole):
    rows = metrics.read(whole.path / "metrics.jsonl")
    assert [(row["iteration"], row["seed"]) for row in rows] == [
        (i, seed) for i in range(1, CHUNKS * CHUNK + 1) for seed in (3, 4)
    ]
    assert all(row["steps"] == row["iteration"] * STEPS for row in rows)
    assert all(row["chunk"] == -(-row["iteration"] // CHUNK) for row in rows)
    assert sum(row["episodes"] for row in rows) > 100 and {len(row) for row in rows} == {
        len(rows[0])
    }
    chunks = metrics.read(whole.path / "chunks.jsonl")
    assert [(row["chunk"], row["seed"]) for row in chunks] == [
        (i, seed) for i in range(1, CHUNKS + 1) for seed in (3, 4)
    ]
    for row in chunks:
        inside = [r for r in rows if (r["chunk"], r["seed"]) == (row["chunk"], row["seed"])]
        crashed = sum(r["outcome/attacker_crash"] * r["episodes"] for r in inside if r["episodes"])
        assert row["episodes"] == sum(r["episodes"] for r in inside)
        assert (row["outcome/attacker_crash"] or 0.0) * row["episodes"] == pytest.approx(crashed)
        assert row["learning_rate/attacker"] == inside[-1]["learning_rate/attacker"]
    assert [row["seconds/compile"] > 0.0 for row in chunks] == [True] * 2 + [False] * (
        2 * CHUNKS - 2
    )
    for row in chunks:
        assert (
            row["seconds/program"] > 0.0
            and row["seconds/rollout"] > 0.0
            and row["seconds/update"] >= 0.0
        )
        assert row["seconds/rollout"] + row["seconds/update"] == pytest.approx(
            row["seconds/program"], abs=0.003
        )
    saved = checkpoint.steps(whole.path / "checkpoints")
    assert saved == [CHUNK * i for i in range(CHUNKS + 1)]  # the untrained state too
    assert (
        checkpoint.read_meta(whole.path / "checkpoints", saved[-1])["steps"]
        == CHUNKS * CHUNK * STEPS
    )
    assert [row["seed"] for row in json.loads((whole.path / "evaluation.json").read_text())] == [
        3,
        4,
    ]
    assert {path.name for path in (whole.path / "tensorboard").iterdir()} == {"seed-3", "seed-4"}
    assert (whole.path / "figures/learning.png").stat().st_size > 1000
    assert settings.load(whole.path / "config.toml").run.name == "whole"
    assert "compiled the training program" in whole.out and "warp" not in whole.out


def test_the_disk_estimate_is_what_a_run_leaves_behind(whole):
    """From below, and not by much, even at a size where tables and logs are most of it."""
    left = sum(path.stat().st_size for path in whole.path.rglob("*") if path.is_file())
    assert 0.5 < estimates.estimated_disk_bytes(whole.config) / left < 1.1


def test_the_same_command_again_has_nothing_to_do(whole, capsys):
    before = digest(whole.path)
    assert training.train(whole.config) == 0
    assert "already complete: 3,072 environment steps per seed" in capsys.readouterr().out
    fewer = replace(whole.config, train=replace(whole.config.train, total_steps=100))
    assert training.train(fewer) == 0 and digest(whole.path) == before


def test_other_settings_in_the_same_directory_are_refused_by_name(whole, capsys):
    flags = [
        *COMMAND,
        *LENGTH,
        "--name",
        "whole",
        "--run.directory",
        str(whole.root),
        "--learn.discount",
        "0.9",
    ]
    assert cli.main(["train", *flags, "--train.num-envs", "32"]) == EXIT_CONFIG
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and err.startswith("error: ")
    assert "learn.discount was 0.99, now 0.9" in err and "train.num_envs was 16, now 32" in err


def test_a_killed_run_goes_on_to_the_same_bits(whole):
    run = whole.root / "killed"
    kill_while_compiling(train(whole.root, "killed"))
    assert checkpoint.steps(run / "checkpoints") == [0] and newest(run / "checkpoints") == 0
    code, _, _ = interrupt(train(whole.root, "killed"), run, after=4, number=signal.SIGKILL)
    assert code == -signal.SIGKILL and (newest(run / "checkpoints") or 0) < CHUNKS * CHUNK
    # what the run leaves may change
    code, out, err = finish(train(whole.root, "killed", "--run.no-figures"))
    assert code == 0 and "resuming after" in out, err
    assert digest(run) == digest(whole.path)
    assert (run / "metrics.jsonl").read_bytes() == (whole.path / "metrics.jsonl").read_bytes()
    assert timeless(run / "chunks.jsonl") == timeless(whole.path / "chunks.jsonl")


@pytest.mark.slow
def test_two_devices_killed_and_resumed_come_to_the_bits_of_one(tmp_path):
    """S-IPPO, a seed on each device; straight on one device, and killed on two."""
    selfplay = ("--selfplay.probability", "0.5", "--run.no-figures")
    code, _, err = finish(train(tmp_path, "straight", *selfplay, "--run.devices", "1"))
    assert code == 0, err
    two, run = (*selfplay, "--run.devices", "2"), tmp_path / "killed"
    code, _, _ = interrupt(train(tmp_path, "killed", *two), run, after=8, number=signal.SIGKILL)
    assert code == -signal.SIGKILL
    code, out, err = finish(train(tmp_path, "killed", *two))
    assert code == 0 and "resuming after" in out and "cpu:1" in out, err
    assert digest(run) == digest(tmp_path / "straight")


def timeless(path: Path) -> list[dict]:
    """The records of chunks without a machine's seconds."""
    rows = metrics.read(path)
    return [
        {key: value for key, value in row.items() if not key.startswith("seconds/")} for row in rows
    ]


@pytest.mark.long
def test_a_fork_without_a_change_comes_to_the_same_bits_and_goes_on_by_the_same_command(whole):
    flags = ("--fork", "child", "--fork-chunk", str(CHUNKS - 2), "--run.no-figures")
    code, out, err = finish(train(whole.root, "whole", *flags))
    assert code == 0 and "forked from" in out and "no setting" in out, err
    child = whole.root / "child"
    assert digest(child) == digest(whole.path) and checkpoint.steps(child / "checkpoints") == [
        28,
        30,
        32,
    ]
    assert (child / "metrics.jsonl").read_bytes() in (whole.path / "metrics.jsonl").read_bytes()
    assert checkpoint.read_meta(child / "checkpoints", 32)["forked"] == {
        "run": "whole",
        "iteration": 28,
    }
    config = settings.load(child / "config.toml")
    # complete
    assert config.run.name == "child" and training.train(config, "whole", CHUNKS - 2) == 0


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_stopped_run_goes_on_to_the_same_bits(whole, number):
    name = f"stopped-{number.name}"
    code, out, _ = interrupt(train(whole.root, name), whole.root / name, after=6, number=number)
    assert code == EXIT_STOPPED and "the same command goes on" in out
    code, out, err = finish(train(whole.root, name))
    assert code == 0 and "resuming after" in out, err
    assert digest(whole.root / name) == digest(whole.path)
