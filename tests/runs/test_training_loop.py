"""The host's loop of a training over a stand-in for the compiled program: signals, disks,
divergence.

What a user's process does at each of these ends is in `test_training`.
"""

import os
import signal
import time
from dataclasses import replace

import numpy as np
import pytest
from toy_training import COMPILING, TOY, ToyState, final_digest, refuse_saves, refused, steps_saved

from dronecombat_jax.config import settings
from dronecombat_jax.errors import (
    EXIT_CANNOT_WRITE,
    EXIT_CONFIG,
    EXIT_DATA,
    EXIT_STOPPED,
)
from dronecombat_jax.files import checkpoint, metrics
from dronecombat_jax.runs import program, training


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGUSR1])
def test_a_signal_saves_at_once_and_the_run_goes_on_from_there(toy, number, capsys):
    assert training.train(toy.config) == 0
    expected, lines = final_digest(toy), (toy.path / "metrics.jsonl").read_bytes()
    config = replace(toy.config, run=replace(toy.config.run, name="stopped"))
    toy.path = toy.path.with_name("stopped")
    toy.hooks[15] = lambda: (os.kill(os.getpid(), number), time.sleep(0.05))
    assert training.train(config) == EXIT_STOPPED
    assert (
        steps_saved(toy) == [10, 15]
        and "stopped after 900 environment steps" in capsys.readouterr().out
    )
    assert training.train(config) == 0 and toy.begun == [0, 0, 15]
    assert final_digest(toy) == expected and (toy.path / "metrics.jsonl").read_bytes() == lines


def test_a_signal_during_the_last_call_is_answered_and_the_run_is_whole(toy):
    toy.hooks[40] = lambda: os.kill(os.getpid(), signal.SIGTERM)
    assert training.train(toy.config) == EXIT_STOPPED and steps_saved(toy)[-1] == 40
    assert training.train(toy.config) == 0 and len(toy.begun) == 1


def test_a_signal_after_the_last_look_is_answered(toy, monkeypatch):
    real = training._run
    monkeypatch.setattr(
        training, "_run", lambda *args: (real(*args), os.kill(os.getpid(), signal.SIGTERM))[0]
    )
    assert training.train(toy.config) == EXIT_STOPPED and steps_saved(toy)[-1] == 40


def test_a_signal_while_compiling_saves_nothing_new_and_loses_nothing(toy):
    assert training.train(replace(toy.config, train=replace(TOY.train, total_steps=20 * 60))) == 0
    toy.hooks[COMPILING] = lambda: (os.kill(os.getpid(), signal.SIGTERM), time.sleep(0.05))
    assert training.train(toy.config) == EXIT_STOPPED and steps_saved(toy) == [10, 20]
    assert training.train(toy.config) == 0 and toy.begun == [0, 20, 20]


@pytest.mark.parametrize(
    ("keep", "left"),
    [
        ("all", [10, 20, 30, 40]),
        ("last 2", [30, 40]),
        ("last 1", [30, 40]),
        ("every 2", [20, 30, 40]),
    ],
)
def test_only_the_checkpoints_that_run_keep_asks_for_stay(toy, keep, left):
    assert training.train(replace(toy.config, run=replace(toy.config.run, keep=keep))) == 0
    assert steps_saved(toy) == left and not list(toy.path.glob("checkpoints/.tmp-*"))


@pytest.mark.parametrize(
    "content", [None, "", "[learn]\ndiscount = 0.5\n"], ids=["gone", "empty", "another"]
)
def test_the_settings_of_a_run_come_from_its_checkpoint(toy, content):
    """The file beside it is written anew; so are metrics that have gone."""
    toy.hooks[15] = lambda: os.kill(os.getpid(), signal.SIGTERM)
    assert training.train(toy.config) == EXIT_STOPPED
    whole = (toy.path / "config.toml").read_bytes()
    (toy.path / "config.toml").unlink() if content is None else (
        toy.path / "config.toml"
    ).write_text(content)
    (toy.path / "metrics.jsonl").unlink()
    (toy.path / "chunks.jsonl").unlink()
    assert training.train(toy.config) == 0 and toy.begun == [0, 15]
    assert (toy.path / "config.toml").read_bytes() == whole
    assert [row["iteration"] for row in metrics.read(toy.path / "metrics.jsonl")] == list(
        range(16, 41)
    )
    assert [row["iterations"] for row in metrics.read(toy.path / "chunks.jsonl")] == [5, 10, 10]
    changed = replace(toy.config, learn=replace(toy.config.learn, discount=0.5))
    (toy.path / "config.toml").write_text(settings.to_toml(changed))
    assert refused(changed).exit_code == EXIT_CONFIG


def test_a_run_killed_before_its_first_checkpoint_begins_anew(toy):
    (toy.path / "checkpoints" / ".tmp-0-1-aa").mkdir(parents=True)
    (toy.path / "config.toml").write_text(
        settings.to_toml(replace(toy.config, train=replace(TOY.train, seed=9)))
    )
    (toy.path / "metrics.jsonl").touch()
    assert training.train(toy.config) == 0


def test_settings_that_this_version_does_not_know_are_one_line(toy):
    assert training.train(toy.config) == 0
    state = ToyState(iteration=np.array([50], np.int32), history=np.ones(3, np.uint64))
    checkpoint.save(toy.path / "checkpoints", 50, state, {"config": "[learn]\nmomentum = 0.5\n"})
    error = refused(toy.config)
    assert (
        error.exit_code == EXIT_DATA
        and "learn.momentum" in error.message
        and "checkpoints/50:2" in error.message
    )


def test_a_chunk_that_was_stopped_inside_is_summed_up_whole(toy):
    """The records of its first half are read back."""
    assert training.train(toy.config) == 0
    expected = [timeless(row) for row in metrics.read(toy.path / "chunks.jsonl")]
    assert [(row["chunk"], row["iterations"], row["episodes"]) for row in expected] == [
        (i, 10, 20) for i in (1, 2, 3, 4)
    ]
    config = replace(toy.config, run=replace(toy.config.run, name="stopped"))
    toy.hooks[15] = lambda: os.kill(os.getpid(), signal.SIGTERM)
    assert training.train(config) == EXIT_STOPPED and training.train(config) == 0
    stopped = metrics.read(toy.path.with_name("stopped") / "chunks.jsonl")
    assert [timeless(row) for row in stopped] == expected


def timeless(row: dict) -> dict:
    """A chunk's record without this machine's seconds."""
    return {key: value for key, value in row.items() if not key.startswith("seconds/")}


def test_chunks_past_the_last_checkpoint_are_cut_at_a_resume(toy, monkeypatch):
    with monkeypatch.context() as patch:
        refuse_saves(patch, {20, 30})
        assert refused(toy.config).exit_code == EXIT_CANNOT_WRITE
    assert len(metrics.read(toy.path / "chunks.jsonl")) == 3
    assert training.train(toy.config) == 0 and toy.begun == [0, 10]
    rows = metrics.read(toy.path / "chunks.jsonl")
    assert [row["chunk"] for row in rows] == [1, 2, 3, 4]
    assert all(
        row[f"seconds/{what}"] >= 0 for row in rows for what in ("compile", "program", "saving")
    )


def test_more_steps_continue_a_finished_run(toy):
    assert training.train(toy.config) == 0
    more = replace(toy.config, train=replace(toy.config.train, total_steps=50 * 60))
    assert (
        training.train(more) == 0
        and steps_saved(toy) == [10, 20, 30, 40, 50]
        and toy.begun == [0, 40]
    )
    assert settings.load(toy.path / "config.toml").train.total_steps == 3000


@pytest.mark.parametrize(
    ("chunk", "expected"),
    [
        (25, 5),
        (10, 5),
        (12, 4),
        (2, 2),
        (1, 1),
        (9, 3),
        (7, 7),
        (14, 7),
        (13, 13),
        (17, 1),
        (34, 2),
    ],
)
def test_a_program_call_divides_a_chunk(chunk, expected):
    config = replace(TOY, train=replace(TOY.train, chunk_iterations=chunk))
    assert program.call_iterations(config) == expected


def test_a_long_iteration_is_a_call_of_its_own_on_a_cpu():
    config = replace(
        TOY,
        train=replace(
            TOY.train, chunk_iterations=25, num_envs=10_000 // TOY.learn.rollout_steps + 1
        ),
    )
    assert program.call_iterations(config) == 1
