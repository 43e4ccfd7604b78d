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
from saved_runs import newest

from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config, LearnConfig, RunConfig, TrainConfig
from dronecombat_jax.errors import (
    EXIT_CANNOT_WRITE,
    EXIT_CONFIG,
    EXIT_DATA,
    EXIT_DIVERGED,
    EXIT_STOPPED,
    UserError,
)
from dronecombat_jax.files import checkpoint, metrics
from dronecombat_jax.files.atomic import cannot_write
from dronecombat_jax.runs import training
from dronecombat_jax.types import Cause, IterationMetrics, RewardTerms, UpdateMetrics

TOY = Config(
    learn=LearnConfig(rollout_steps=6, epochs=2, minibatches=3),
    train=TrainConfig(num_envs=10, chunk_iterations=10, total_steps=40 * 60, seed=1),
)


COMPILING = -1  # the hook of the compilation


class ToyState(struct.PyTreeNode):
    """What the host reads of a state, and something that remembers every call."""

    iteration: np.ndarray
    history: np.ndarray
    selfplay: None = None


@pytest.fixture
def toy(monkeypatch, tmp_path) -> SimpleNamespace:
    """`train(config)` over a program that counts; `hooks[iteration]` is called when it gets there."""
    hooks: dict[int, Callable[[], object]] = {}
    faults = {"skipped": 0, "diverged": 0}  # of every iteration: gradient steps, fights
    begun: list[int] = []

    def advance(state: ToyState):
        done = int(state.iteration[0]) + training.call_iterations(TOY)
        report = _report(training.call_iterations(TOY), **faults)
        if hook := hooks.pop(done, None):
            hook()
        return ToyState(iteration=np.array([done], np.int32), history=state.history * 3 + done), report

    def prepare(run, config, start, saver):
        begun.append(start.iteration if start else 0)
        state = ToyState(iteration=np.zeros(1, np.int32), history=np.ones(3, np.uint64))
        if start is not None:
            state = checkpoint.restore(run.checkpoints, start.iteration, state)
            for log in (run.metrics, run.chunks):
                metrics.truncate_after(log, start.iteration * config.steps_per_iteration)
        return state, compile_program

    def compile_program(state):
        if hook := hooks.pop(COMPILING, None):
            hook()
        return advance

    monkeypatch.setattr(training, "_prepare", prepare)
    monkeypatch.setattr(training, "flight_seconds", lambda config, state: 1e-6)
    config = replace(TOY, run=RunConfig(name="toy", directory=str(tmp_path)))
    path = tmp_path / "toy"
    return SimpleNamespace(config=config, path=path, hooks=hooks, faults=faults, begun=begun)


def _report(iterations: int, skipped: int, diverged: int) -> IterationMetrics:
    zeros = np.zeros((1, iterations, 2), np.float32)
    learners = UpdateMetrics(*[zeros] * len(UpdateMetrics._fields))._replace(
        skipped=np.array([[[0, skipped]] * iterations])
    )
    causes = np.zeros((1, iterations, len(Cause)), np.int32)
    causes[..., Cause.DIVERGED] = diverged
    causes[..., Cause.REACHED] = 2
    nobody = np.full((1, iterations), -1)
    return IterationMetrics(  # pyright: ignore[reportArgumentType]
        causes=causes,
        crashes=zeros.astype(int),
        episode_steps=causes[..., 0],
        returns=zeros,
        diverged=causes[..., Cause.DIVERGED],
        reward_terms=RewardTerms(*[zeros] * 7),
        learners=learners,
        frozen=nobody,
        opponent=nobody,
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


def test_a_signal_during_the_last_call_is_answered_and_the_run_is_whole(toy):
    toy.hooks[40] = lambda: os.kill(os.getpid(), signal.SIGTERM)
    assert training.train(toy.config) == EXIT_STOPPED and steps_saved(toy)[-1] == 40
    assert training.train(toy.config) == 0 and len(toy.begun) == 1


def test_a_signal_after_the_last_look_is_answered(toy, monkeypatch):
    real = training._run
    monkeypatch.setattr(training, "_run", lambda *args: (real(*args), os.kill(os.getpid(), signal.SIGTERM))[0])
    assert training.train(toy.config) == EXIT_STOPPED and steps_saved(toy)[-1] == 40


def test_a_signal_while_compiling_saves_nothing_new_and_loses_nothing(toy):
    assert training.train(replace(toy.config, train=replace(TOY.train, total_steps=20 * 60))) == 0
    toy.hooks[COMPILING] = lambda: (os.kill(os.getpid(), signal.SIGTERM), time.sleep(0.05))
    assert training.train(toy.config) == EXIT_STOPPED and steps_saved(toy) == [10, 20]
    assert training.train(toy.config) == 0 and toy.begun == [0, 20, 20]


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

    def save(directory, step, state, meta, **options):
        if step in at:
            raise cannot_write(directory / str(step), OSError(errno.ENOSPC, "No space left on device"), 100)
        return real(directory, step, state, meta, **options)

    monkeypatch.setattr(checkpoint, "save", save)


@pytest.mark.parametrize(
    ("keep", "left"),
    [("all", [10, 20, 30, 40]), ("last 2", [30, 40]), ("last 1", [30, 40]), ("every 2", [20, 30, 40])],
)
def test_only_the_checkpoints_that_run_keep_asks_for_stay(toy, keep, left):
    assert training.train(replace(toy.config, run=replace(toy.config.run, keep=keep))) == 0
    assert steps_saved(toy) == left and not list(toy.path.glob("checkpoints/.tmp-*"))


def test_a_directory_that_was_moved_away_is_replaced(toy, capsys):
    toy.hooks[15] = lambda: toy.path.rename(toy.path.with_name("moved"))
    assert training.train(toy.config) == 0
    rescued = toy.path.with_name(f"toy.rescued-{os.getpid()}")
    assert checkpoint.steps(rescued / "checkpoints") == [20, 30, 40] and "has gone" in capsys.readouterr().out
    assert settings.load(rescued / "config.toml") == toy.config


def refused(config: Config) -> UserError:
    with pytest.raises(UserError) as error:
        training.train(config)
    assert "\n" not in error.value.message
    return error.value


def test_five_iterations_without_one_gradient_end_the_training_and_leave_its_state(toy):
    toy.hooks[15] = lambda: toy.faults.update(skipped=6)  # every gradient step, from the next call on
    error = refused(toy.config)
    assert error.exit_code == EXIT_DIVERGED and "not one finite gradient for the attacker of seed 1" in error.message
    assert "up to 20 " in error.message and str(toy.path / "diverged-20.npz") in error.message
    assert steps_saved(toy) == [10] and newest(toy.path / "checkpoints") == 10
    with np.load(toy.path / "diverged-20.npz", allow_pickle=False) as dump:
        assert dump["state/iteration"] == [20] and np.all(dump["report/learners/skipped"][0, :, 1] == 6)


def test_some_skipped_steps_are_not_the_end(toy):
    toy.faults.update(skipped=5)  # of 6
    assert training.train(toy.config) == 0


def test_rows_of_bad_iterations_go_on_from_call_to_call(toy, monkeypatch):
    """Calls of one iteration: no call alone has five in a row."""
    monkeypatch.setattr(training, "call_iterations", lambda config: 1)
    toy.hooks[12] = lambda: toy.faults.update(skipped=6)
    assert "up to 17 " in refused(toy.config).message  # 13 to 17
    toy.faults.update(skipped=0, diverged=0)
    toy.hooks[12] = lambda: toy.faults.update(diverged=1)  # a tenth of the environments
    error = refused(toy.config)
    assert error.exit_code == EXIT_DIVERGED and "in each of iterations 13 to 15" in error.message
    assert "over 1% of the environments of seed 1" in error.message and (toy.path / "diverged-15.npz").exists()


def test_two_iterations_of_divergence_are_logged_and_forgiven(toy, monkeypatch):
    monkeypatch.setattr(training, "call_iterations", lambda config: 1)
    for start in (12, 22):
        toy.hooks[start] = lambda: toy.faults.update(diverged=1)
        toy.hooks[start + 2] = lambda: toy.faults.update(diverged=0)
    assert training.train(toy.config) == 0
    rows = metrics.read(toy.path / "metrics.jsonl")
    assert [row["iteration"] for row in rows if row["diverged"]] == [13, 14, 23, 24]
    assert rows[12]["diverged_environments"] == 0.1 and rows[12]["outcome/diverged"] == pytest.approx(1 / 3)
    assert [row["diverged"] for row in metrics.read(toy.path / "chunks.jsonl")] == [0, 2, 2, 0]


@pytest.mark.parametrize(
    ("said", "code", "advice"),
    [
        ("RESOURCE_EXHAUSTED: Out of memory allocating 9 bytes.", EXIT_CONFIG, "fewer train.num_envs"),
        ("INTERNAL: CUDA_ERROR_DEVICE_UNAVAILABLE\nbacktrace", EXIT_STOPPED, "the same command goes on"),
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


@pytest.mark.parametrize("content", [None, "", "[learn]\ndiscount = 0.5\n"], ids=["gone", "empty", "another"])
def test_the_settings_of_a_run_come_from_its_checkpoint(toy, content):
    """The file beside it is written anew; so are metrics that have gone."""
    toy.hooks[15] = lambda: os.kill(os.getpid(), signal.SIGTERM)
    assert training.train(toy.config) == EXIT_STOPPED
    whole = (toy.path / "config.toml").read_bytes()
    (toy.path / "config.toml").unlink() if content is None else (toy.path / "config.toml").write_text(content)
    (toy.path / "metrics.jsonl").unlink()
    (toy.path / "chunks.jsonl").unlink()
    assert training.train(toy.config) == 0 and toy.begun == [0, 15]
    assert (toy.path / "config.toml").read_bytes() == whole
    assert [row["iteration"] for row in metrics.read(toy.path / "metrics.jsonl")] == list(range(16, 41))
    assert [row["iterations"] for row in metrics.read(toy.path / "chunks.jsonl")] == [5, 10, 10]
    changed = replace(toy.config, learn=replace(toy.config.learn, discount=0.5))
    (toy.path / "config.toml").write_text(settings.to_toml(changed))
    assert refused(changed).exit_code == EXIT_CONFIG


def damage(toy: SimpleNamespace) -> None:
    for step in steps_saved(toy):
        (toy.path / "checkpoints" / str(step) / "manifest.json").write_text("")


def test_a_run_whose_checkpoints_are_all_damaged_is_not_begun_anew(toy):
    assert training.train(toy.config) == 0
    kept = {name: (toy.path / name).read_bytes() for name in ("metrics.jsonl", "chunks.jsonl", "config.toml")}
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


def test_a_run_killed_before_its_first_checkpoint_begins_anew(toy):
    (toy.path / "checkpoints" / ".tmp-0-1-aa").mkdir(parents=True)
    (toy.path / "config.toml").write_text(settings.to_toml(replace(toy.config, train=replace(TOY.train, seed=9))))
    (toy.path / "metrics.jsonl").touch()
    assert training.train(toy.config) == 0


def test_settings_that_this_version_does_not_know_are_one_line(toy):
    assert training.train(toy.config) == 0
    state = ToyState(iteration=np.array([50], np.int32), history=np.ones(3, np.uint64))
    checkpoint.save(toy.path / "checkpoints", 50, state, {"config": "[learn]\nmomentum = 0.5\n"})
    error = refused(toy.config)
    assert error.exit_code == EXIT_DATA and "learn.momentum" in error.message and "checkpoints/50:2" in error.message


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
    assert all(row[f"seconds/{what}"] >= 0 for row in rows for what in ("compile", "program", "saving"))


def test_more_steps_continue_a_finished_run(toy):
    assert training.train(toy.config) == 0
    more = replace(toy.config, train=replace(toy.config.train, total_steps=50 * 60))
    assert training.train(more) == 0 and steps_saved(toy) == [10, 20, 30, 40, 50] and toy.begun == [0, 40]
    assert settings.load(toy.path / "config.toml").train.total_steps == 3000


@pytest.mark.parametrize(
    ("chunk", "expected"),
    [(25, 5), (10, 5), (12, 4), (2, 2), (1, 1), (9, 3), (7, 7), (14, 7), (13, 13), (17, 1), (34, 2)],
)
def test_a_program_call_divides_a_chunk(chunk, expected):
    config = replace(TOY, train=replace(TOY.train, chunk_iterations=chunk))
    assert training.call_iterations(config) == expected


def test_a_long_iteration_is_a_call_of_its_own_on_a_cpu():
    config = replace(TOY, train=replace(TOY.train, chunk_iterations=25, num_envs=10_000 // TOY.learn.rollout_steps + 1))
    assert training.call_iterations(config) == 1
