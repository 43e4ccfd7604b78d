"""Training as a user meets it: one command to begin, to go on after any end, and to be told what is wrong.

The commands run in processes of their own, at toy size and compiled with little optimisation.
"""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from dronecombat_jax import cli, settings
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_STOPPED
from dronecombat_jax.runs import checkpoint, metrics, training

CHUNKS, CHUNK = 16, 2  # chunks and iterations of one
STEPS = 16 * 6  # environment steps of one iteration
COMMAND = (
    "--preset smoke --seed 3 --train.num-envs 16 --train.chunk-iterations 2 --sim.substeps 1 --game.episode-steps 20 "
    "--learn.hidden-sizes 8 8 --learn.rollout-steps 6 --learn.epochs 2 --learn.minibatches 2 "
    f"--train.num-seeds 2 --steps {CHUNKS * CHUNK * STEPS} --run.no-video --run.evaluation-fights 4"
).split()
QUICK_TO_COMPILE = "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true"
PATIENCE = 300.0  # seconds


def train(root: Path, name: str, *flags: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "dronecombat_jax.cli", "train", "--name", name, "--run.directory", str(root)]
    environment = os.environ | {"XLA_FLAGS": f"{os.environ.get('XLA_FLAGS', '')} {QUICK_TO_COMPILE}".strip()}
    pipe = subprocess.PIPE
    return subprocess.Popen([*command, *COMMAND, *flags], stdout=pipe, stderr=pipe, text=True, env=environment)


def finish(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=PATIENCE)
    return process.returncode, out, err


def interrupt(process: subprocess.Popen[str], run: Path, after: int, number: signal.Signals) -> tuple[int, str, str]:
    """Send a signal once the checkpoint of `after` iterations is there."""
    deadline = time.monotonic() + PATIENCE
    while not (run / "checkpoints" / str(after)).exists():
        assert process.poll() is None and time.monotonic() < deadline, process.communicate()
        time.sleep(0.005)
    process.send_signal(number)
    return finish(process)


def digest(run: Path) -> str:
    return checkpoint.verify(run / "checkpoints", CHUNKS * CHUNK).digest


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> SimpleNamespace:
    """The run that nothing interrupts, begun by the command line."""
    root = tmp_path_factory.mktemp("runs")
    code, out, err = finish(train(root, "whole"))
    assert code == 0, err
    return SimpleNamespace(root=root, path=root / "whole", out=out, config=settings.load(root / "whole/config.toml"))


def test_a_training_leaves_its_files_and_complete_metrics(whole):
    rows = metrics.read(whole.path / "metrics.jsonl")
    assert [(row["iteration"], row["seed"]) for row in rows] == [
        (i, seed) for i in range(1, CHUNKS * CHUNK + 1) for seed in (3, 4)
    ]
    assert all(row["steps"] == row["iteration"] * STEPS for row in rows)
    assert all(row["chunk"] == -(-row["iteration"] // CHUNK) for row in rows)
    assert sum(row["episodes"] for row in rows) > 100 and {len(row) for row in rows} == {len(rows[0])}
    saved = checkpoint.steps(whole.path / "checkpoints")
    assert saved == [CHUNK * i for i in range(CHUNKS + 1)]  # the untrained state too
    assert checkpoint.read_meta(whole.path / "checkpoints", saved[-1])["steps"] == CHUNKS * CHUNK * STEPS
    assert [row["seed"] for row in json.loads((whole.path / "evaluation.json").read_text())] == [3, 4]
    assert {path.name for path in (whole.path / "tensorboard").iterdir()} == {"seed-3", "seed-4"}
    assert (whole.path / "figures/learning.png").stat().st_size > 1000
    assert settings.load(whole.path / "config.toml").run.name == "whole"
    assert "compiled the training program" in whole.out and "warp" not in whole.out


def test_the_same_command_again_has_nothing_to_do(whole, capsys):
    before = digest(whole.path)
    assert training.train(whole.config) == 0
    assert "already complete: 3,072 environment steps per seed" in capsys.readouterr().out
    fewer = replace(whole.config, train=replace(whole.config.train, total_steps=100))
    assert training.train(fewer) == 0 and digest(whole.path) == before


def test_other_settings_in_the_same_directory_are_refused_by_name(whole, capsys):
    flags = [*COMMAND, "--name", "whole", "--run.directory", str(whole.root), "--learn.discount", "0.9"]
    assert cli.main(["train", *flags, "--train.num-envs", "32"]) == EXIT_CONFIG
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and err.startswith("error: ")
    assert "learn.discount was 0.99, now 0.9" in err and "train.num_envs was 16, now 32" in err


def test_a_killed_run_goes_on_to_the_same_bits(whole):
    run = whole.root / "killed"
    code, _, _ = interrupt(train(whole.root, "killed"), run, after=4, number=signal.SIGKILL)
    assert code == -signal.SIGKILL and (checkpoint.latest(run / "checkpoints") or 0) < CHUNKS * CHUNK
    code, out, err = finish(train(whole.root, "killed", "--run.no-figures"))  # what the run leaves may change
    assert code == 0 and "resuming after" in out, err
    assert digest(run) == digest(whole.path)
    assert (run / "metrics.jsonl").read_bytes() == (whole.path / "metrics.jsonl").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_stopped_run_goes_on_to_the_same_bits(whole, number):
    name = f"stopped-{number.name}"
    code, out, _ = interrupt(train(whole.root, name), whole.root / name, after=6, number=number)
    assert code == EXIT_STOPPED and "the same command goes on" in out
    code, out, err = finish(train(whole.root, name))
    assert code == 0 and "resuming after" in out, err
    assert digest(whole.root / name) == digest(whole.path)
