"""The host's loop of a training over a stand-in for the compiled program: signals, disks, divergence.

What a user's process does at each of these ends is in `test_training`.
"""

import errno
import os
import signal
import time
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from flax import struct

from dronecombat_jax import settings
from dronecombat_jax.config import Config, LearnConfig, RunConfig, TrainConfig
from dronecombat_jax.errors import EXIT_CANNOT_WRITE, EXIT_DATA, EXIT_DIVERGED, EXIT_STOPPED, UserError
from dronecombat_jax.runs import checkpoint, metrics, training
from dronecombat_jax.runs.atomic import cannot_write
from dronecombat_jax.types import Cause, IterationMetrics, RewardTerms, UpdateMetrics

TOY = Config(
    learn=LearnConfig(rollout_steps=6, epochs=2, minibatches=3),
    train=TrainConfig(num_envs=10, chunk_iterations=10, total_steps=40 * 60, seed=1),
)


class ToyState(struct.PyTreeNode):
    """What the host reads of a state, and something that remembers every call."""

    iteration: np.ndarray
    history: np.ndarray


@pytest.fixture
def toy(monkeypatch, tmp_path) -> SimpleNamespace:
    """`train(config)` over a program that counts; `hooks[iteration]` is called when it gets there."""
    hooks: dict[int, Callable[[], object]] = {}
    skipped = {"steps": 0}
    begun: list[int] = []

    def advance(state: ToyState):
        done = int(state.iteration[0]) + training.call_iterations(TOY)
        report = _report(training.call_iterations(TOY), skipped["steps"])
        if hook := hooks.pop(done, None):
            hook()
        return ToyState(iteration=np.array([done], np.int32), history=state.history * 3 + done), report

    def prepare(run, config, start, progress):
        begun.append(start or 0)
        state = ToyState(iteration=np.zeros(1, np.int32), history=np.ones(3, np.uint64))
        if start is not None:
            state = checkpoint.restore(run.checkpoints, start, state)
            metrics.truncate_after(run.metrics, start * config.steps_per_iteration)
        return state, advance

    monkeypatch.setattr(training, "_prepare", prepare)
    config = replace(TOY, run=RunConfig(name="toy", directory=str(tmp_path)))
    path = tmp_path / "toy"
    return SimpleNamespace(config=config, path=path, hooks=hooks, skipped=skipped, begun=begun)


def _report(iterations: int, skipped: int) -> IterationMetrics:
    zeros = np.zeros((1, iterations, 2), np.float32)
    learners = UpdateMetrics(*[zeros] * len(UpdateMetrics._fields))._replace(
        skipped=np.array([[[0, skipped]] * iterations])
    )
    causes = np.zeros((1, iterations, len(Cause)), np.int32)
    return IterationMetrics(  # pyright: ignore[reportArgumentType]
        causes, zeros.astype(int), causes[..., 0], RewardTerms(*[zeros] * 7), learners
    )


def steps_saved(toy: SimpleNamespace) -> list[int]:
    return checkpoint.steps(toy.path / "checkpoints")


def final_digest(toy: SimpleNamespace) -> str:
    return checkpoint.verify(toy.path / "checkpoints", 40).digest


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGUSR1])
def test_a_signal_saves_at_once_and_the_run_goes_on_from_there(toy, number, capsys):
    assert training.train(toy.config) == 0
    expected, lines = final_digest(toy), (toy.path / "metrics.jsonl").read_bytes()
    config = replace(toy.config, run=replace(toy.config.run, name="stopped"))
    toy.path = toy.path.with_name("stopped")
    toy.hooks[15] = lambda: (os.kill(os.getpid(), number), time.sleep(0.05))
    assert training.train(config) == EXIT_STOPPED
    assert steps_saved(toy) == [10, 15] and "stopped after 900 environment steps" in capsys.readouterr().out
    assert training.train(config) == 0 and toy.begun == [0, 0, 15]
    assert final_digest(toy) == expected and (toy.path / "metrics.jsonl").read_bytes() == lines


def test_a_signal_during_the_last_call_is_a_finished_run(toy):
    toy.hooks[40] = lambda: os.kill(os.getpid(), signal.SIGTERM)
    assert training.train(toy.config) == 0 and steps_saved(toy)[-1] == 40


def test_a_disk_that_refuses_once_is_forgiven(toy, monkeypatch, capsys):
    refuse_saves(monkeypatch, {20})
    assert training.train(toy.config) == 0
    assert steps_saved(toy) == [10, 30, 40] and "trying again at the next save" in capsys.readouterr().out


@pytest.mark.parametrize("refused", [{20, 30}, {40}], ids=["twice running", "at the end"])
def test_a_disk_that_goes_on_refusing_stops_the_run(toy, monkeypatch, refused):
    refuse_saves(monkeypatch, refused)
    with pytest.raises(UserError) as error:
        training.train(toy.config)
    assert error.value.exit_code == EXIT_CANNOT_WRITE and "No space left" in error.value.message
    monkeypatch.undo()
    assert steps_saved(toy)[-1] == min(refused) - 10  # the last good one stands


def refuse_saves(monkeypatch, at: set[int]) -> None:
    real = checkpoint.save

    def save(directory, step, state, meta):
        if step in at:
            raise cannot_write(directory / str(step), OSError(errno.ENOSPC, "No space left on device"), 100)
        return real(directory, step, state, meta)

    monkeypatch.setattr(checkpoint, "save", save)


def test_a_directory_that_was_moved_away_is_replaced(toy, capsys):
    toy.hooks[15] = lambda: toy.path.rename(toy.path.with_name("moved"))
    assert training.train(toy.config) == 0
    rescued = toy.path.with_name(f"toy.rescued-{os.getpid()}")
    assert checkpoint.steps(rescued / "checkpoints") == [20, 30, 40] and "has gone" in capsys.readouterr().out
    assert settings.load(rescued / "config.toml") == toy.config


def test_training_that_diverged_stops_with_its_last_checkpoint_intact(toy):
    toy.hooks[15] = lambda: toy.skipped.update(steps=6)  # every gradient step, from the next call on
    with pytest.raises(UserError) as error:
        training.train(toy.config)
    assert error.value.exit_code == EXIT_DIVERGED and "iterations 15 to 20" in error.value.message
    assert steps_saved(toy) == [10] and checkpoint.latest(toy.path / "checkpoints") == 10


def test_some_skipped_steps_are_not_the_end(toy):
    toy.skipped.update(steps=5)  # of 6
    assert training.train(toy.config) == 0


def test_checkpoints_without_their_settings_are_not_guessed_at(toy):
    assert training.train(toy.config) == 0
    (toy.path / "config.toml").unlink()
    with pytest.raises(UserError) as error:
        training.train(toy.config)
    assert error.value.exit_code == EXIT_DATA and "config.toml is missing" in error.value.message


def test_more_steps_continue_a_finished_run(toy):
    assert training.train(toy.config) == 0
    more = replace(toy.config, train=replace(toy.config.train, total_steps=50 * 60))
    assert training.train(more) == 0 and steps_saved(toy) == [10, 20, 30, 40, 50] and toy.begun == [0, 40]
    assert settings.load(toy.path / "config.toml").train.total_steps == 3000


@pytest.mark.parametrize(("chunk", "expected"), [(25, 5), (10, 5), (12, 4), (2, 2), (1, 1), (7, 1), (9, 3)])
def test_a_program_call_divides_a_chunk(chunk, expected):
    config = replace(TOY, train=replace(TOY.train, chunk_iterations=chunk))
    assert training.call_iterations(config) == expected
