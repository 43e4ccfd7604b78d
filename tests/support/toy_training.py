"""A training loop whose program is a toy."""

import errno
from types import SimpleNamespace

import numpy as np
import pytest
from flax import struct

from dronecombat_jax.config.fields import Config, LearnConfig, TrainConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.files import checkpoint
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


def report_of(iterations: int, skipped: int, diverged: int) -> IterationMetrics:
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
