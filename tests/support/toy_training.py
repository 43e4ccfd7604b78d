"""A training loop whose program is a toy."""

import errno
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from flax import struct

from dronecombat_jax.config.fields import Config, LearnConfig, RunConfig, TrainConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.files import checkpoint, metrics
from dronecombat_jax.files.atomic import cannot_write
from dronecombat_jax.runs import training
from dronecombat_jax.types import Cause, IterationMetrics, RewardTerms, UpdateMetrics


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
        return ToyState(
            iteration=np.array([done], np.int32), history=state.history * 3 + done
        ), report

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


def refuse_saves(monkeypatch, at: set[int]) -> None:
    real = checkpoint.save

    def save(directory, step, state, meta, **options):
        if step in at:
            raise cannot_write(
                directory / str(step), OSError(errno.ENOSPC, "No space left on device"), 100
            )
        return real(directory, step, state, meta, **options)

    monkeypatch.setattr(checkpoint, "save", save)


def refused(config: Config) -> UserError:
    with pytest.raises(UserError) as error:
        training.train(config)
    assert "\n" not in error.value.message
    return error.value
