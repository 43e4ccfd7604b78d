"""The training loop when a disk, a device or the learning fails."""

import os
from types import SimpleNamespace

import numpy as np
import pytest
from saved_runs import newest
from toy_training import refuse_saves, refused, steps_saved

from dronecombat_jax.config import settings
from dronecombat_jax.errors import (
    EXIT_CANNOT_WRITE,
    EXIT_CONFIG,
    EXIT_DATA,
    EXIT_DIVERGED,
    EXIT_STOPPED,
    UserError,
)
from dronecombat_jax.files import checkpoint, metrics
from dronecombat_jax.runs import program, training


def test_a_disk_that_refuses_once_is_forgiven(toy, monkeypatch, capsys):
    refuse_saves(monkeypatch, {20})
    assert training.train(toy.config) == 0
    assert (
        steps_saved(toy) == [10, 30, 40]
        and "trying again at the next save" in capsys.readouterr().out
    )


@pytest.mark.parametrize("refused", [{20, 30}, {40}], ids=["twice running", "at the end"])
def test_a_disk_that_goes_on_refusing_stops_the_run(toy, monkeypatch, refused):
    refuse_saves(monkeypatch, refused)
    with pytest.raises(UserError) as error:
        training.train(toy.config)
    assert error.value.exit_code == EXIT_CANNOT_WRITE and "No space left" in error.value.message
    monkeypatch.undo()
    assert steps_saved(toy)[-1] == min(refused) - 10  # the last good one stands


def test_a_directory_that_was_moved_away_is_replaced(toy, capsys):
    toy.hooks[15] = lambda: toy.path.rename(toy.path.with_name("moved"))
    assert training.train(toy.config) == 0
    rescued = toy.path.with_name(f"toy.rescued-{os.getpid()}")
    assert (
        checkpoint.steps(rescued / "checkpoints") == [20, 30, 40]
        and "has gone" in capsys.readouterr().out
    )
    assert settings.load(rescued / "config.toml") == toy.config


def test_five_iterations_without_one_gradient_end_the_training_and_leave_its_state(toy):
    # every gradient step, from the next call on
    toy.hooks[15] = lambda: toy.faults.update(skipped=6)
    error = refused(toy.config)
    assert (
        error.exit_code == EXIT_DIVERGED
        and "not one finite gradient for the attacker of seed 1" in error.message
    )
    assert "up to 20 " in error.message and str(toy.path / "diverged-20.npz") in error.message
    assert steps_saved(toy) == [10] and newest(toy.path / "checkpoints") == 10
    with np.load(toy.path / "diverged-20.npz", allow_pickle=False) as dump:
        assert dump["state/iteration"] == [20] and np.all(
            dump["report/learners/skipped"][0, :, 1] == 6
        )


def test_some_skipped_steps_are_not_the_end(toy):
    toy.faults.update(skipped=5)  # of 6
    assert training.train(toy.config) == 0


def test_rows_of_bad_iterations_go_on_from_call_to_call(toy, monkeypatch):
    """Calls of one iteration: no call alone has five in a row."""
    monkeypatch.setattr(program, "call_iterations", lambda config: 1)
    toy.hooks[12] = lambda: toy.faults.update(skipped=6)
    assert "up to 17 " in refused(toy.config).message  # 13 to 17
    toy.faults.update(skipped=0, diverged=0)
    toy.hooks[12] = lambda: toy.faults.update(diverged=1)  # a tenth of the environments
    error = refused(toy.config)
    assert error.exit_code == EXIT_DIVERGED and "in each of iterations 13 to 15" in error.message
    assert (
        "over 1% of the environments of seed 1" in error.message
        and (toy.path / "diverged-15.npz").exists()
    )


def test_two_iterations_of_divergence_are_logged_and_forgiven(toy, monkeypatch):
    monkeypatch.setattr(program, "call_iterations", lambda config: 1)
    for start in (12, 22):
        toy.hooks[start] = lambda: toy.faults.update(diverged=1)
        toy.hooks[start + 2] = lambda: toy.faults.update(diverged=0)
    assert training.train(toy.config) == 0
    rows = metrics.read(toy.path / "metrics.jsonl")
    assert [row["iteration"] for row in rows if row["diverged"]] == [13, 14, 23, 24]
    assert rows[12]["diverged_environments"] == 0.1 and rows[12][
        "outcome/diverged"
    ] == pytest.approx(1 / 3)
    assert [row["diverged"] for row in metrics.read(toy.path / "chunks.jsonl")] == [0, 2, 2, 0]


@pytest.mark.parametrize(
    ("said", "code", "advice"),
    [
        (
            "RESOURCE_EXHAUSTED: Out of memory allocating 9 bytes.",
            EXIT_CONFIG,
            "fewer train.num_envs",
        ),
        (
            "INTERNAL: CUDA_ERROR_DEVICE_UNAVAILABLE\nbacktrace",
            EXIT_STOPPED,
            "the same command goes on",
        ),
    ],
)
def test_a_device_that_fails_is_one_line_and_costs_no_checkpoint(toy, said, code, advice):
    import jax

    def fail():
        raise jax.errors.JaxRuntimeError(said)

    toy.hooks[25] = fail
    error = refused(toy.config)
    assert error.exit_code == code and advice in error.message and said[:18] in error.message
    assert training.train(toy.config) == 0 and toy.begun == [0, 20]


def damage(toy: SimpleNamespace) -> None:
    for step in steps_saved(toy):
        (toy.path / "checkpoints" / str(step) / "manifest.json").write_text("")


def test_a_run_whose_checkpoints_are_all_damaged_is_not_begun_anew(toy):
    assert training.train(toy.config) == 0
    kept = {
        name: (toy.path / name).read_bytes()
        for name in ("metrics.jsonl", "chunks.jsonl", "config.toml")
    }
    damage(toy)
    for _ in range(2):  # what was set aside the first time still counts
        error = refused(toy.config)
        assert error.exit_code == EXIT_DATA and "set aside as damaged-10-" in error.message
        assert "choose another --name, or move" in error.message
    assert {name: (toy.path / name).read_bytes() for name in kept} == kept
    assert len(list((toy.path / "checkpoints").glob("damaged-*"))) == 4 and toy.begun == [0]


def test_metrics_without_a_checkpoint_are_not_overwritten(toy):
    assert training.train(toy.config) == 0
    for path in sorted((toy.path / "checkpoints").rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()
    error = refused(toy.config)
    assert error.exit_code == EXIT_DATA and "they are gone" in error.message
    assert len(metrics.read(toy.path / "metrics.jsonl")) == 40
