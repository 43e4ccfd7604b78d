"""When training has to stop: too many diverged fights, too many lost updates, a device that fails;
and how its state is dumped then.

One diverged fight is a tie and one gradient that is not finite is skipped, both inside the program
(`combat.env`, `learn.ippo`). What lives here counts them across program calls.
"""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_STOPPED, UserError
from dronecombat_jax.files.arrays import flatten
from dronecombat_jax.files.atomic import write_atomic
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.runs.records import learning_pupils
from dronecombat_jax.types import IterationMetrics

DIVERGED_SHARE = 0.01  # of the environments, in one iteration
DIVERGED_ITERATIONS = 3
SKIPPED_ITERATIONS = 5


class Watch:
    """Counts bad iterations in a row, for every seed, over all calls of one process."""

    def __init__(self, config: Config):
        self._config = config
        self._diverged = np.zeros(config.train.num_seeds, int)
        self._skipped = np.zeros((config.train.num_seeds, len(config.pupils)), int)

    def verdict(self, report: IterationMetrics, first_iteration: int) -> str:
        """Why training must stop after these iterations, or ""; leaves of `report` are NumPy [S, I,
        ...].

        Iterations in which somebody does not learn neither count nor end its row.
        """
        learn, train = self._config.learn, self._config.train
        learning = learning_pupils(self._config, report, first_iteration)
        lost = np.asarray(report.learners.skipped) >= learn.epochs * learn.minibatches
        many = np.asarray(report.diverged) > DIVERGED_SHARE * train.num_envs
        for i in range(many.shape[1]):
            self._diverged = np.where(many[:, i], self._diverged + 1, 0)
            self._skipped = np.where(
                learning[:, i], np.where(lost[:, i], self._skipped + 1, 0), self._skipped
            )
            done = first_iteration + i + 1
            if np.any(self._diverged >= DIVERGED_ITERATIONS):
                seed = train.seed + int(np.argmax(self._diverged))
                return (
                    f"the simulation diverged in over {DIVERGED_SHARE:.0%} of the environments of seed {seed} in "
                    f"each of iterations {done - DIVERGED_ITERATIONS + 1} to {done} (a smaller sim.timestep may help)"
                )
            if np.any(self._skipped >= SKIPPED_ITERATIONS):
                seed, index = np.unravel_index(np.argmax(self._skipped), self._skipped.shape)
                return (
                    f"not one finite gradient for the {self._config.pupils[index].name} of seed {train.seed + int(seed)} in its last "
                    f"{SKIPPED_ITERATIONS} iterations, up to {done} (a smaller learn.learning_rate may help)"
                )
        return ""


def write_dump(run: RunDirectory, state: Any, report: IterationMetrics, iteration: int) -> str:
    """Save state and last metrics (NumPy leaves) as `diverged-<iteration>.npz` and say where; never
    raises UserError.

    The steps before are not kept: from the last checkpoint the same command repeats them, bit for
    bit.
    """
    path = run.path / f"diverged-{iteration}.npz"
    arrays = {f"state/{name}": array for name, array in flatten(state).items()}
    arrays |= {f"report/{name}": array for name, array in flatten(report).items()}
    content = io.BytesIO()
    np.savez(content, **arrays)  # pyright: ignore[reportArgumentType] - names are free
    try:
        write_atomic(path, content.getvalue())
    except UserError as error:
        return f"its state could not be kept ({error.message})"
    return f"its state is in {path}"


@contextmanager
def device_errors() -> Iterator[None]:
    """Turn a device's error into one line: UserError 2 out of memory, 75 for all else."""
    import jax

    try:
        yield
    except jax.errors.JaxRuntimeError as error:
        text = str(error)
        if "RESOURCE_EXHAUSTED" in text or "out of memory" in text.lower():
            message = (
                "the device is out of memory: fewer train.num_envs or train.num_seeds, more learn.minibatches or a "
                f"smaller pool need less; the last checkpoint is intact ({one_line(text)})"
            )
            raise UserError(message, EXIT_CONFIG) from error
        message = f"the device failed; the last checkpoint is intact, the same command goes on ({one_line(text)})"
        raise UserError(message, EXIT_STOPPED) from error
