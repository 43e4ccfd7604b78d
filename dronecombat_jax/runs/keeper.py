"""What a training leaves behind between two program calls: records, progress, checkpoints, a dump
where it diverged.

The first process has a keeper, any other has none: it computes its share and writes nothing.
"""

from contextlib import AbstractContextManager, ExitStack, nullcontext
from types import TracebackType

from dronecombat_jax.config.fields import Config
from dronecombat_jax.errors import EXIT_DIVERGED, UserError
from dronecombat_jax.files.metrics import MetricsWriter
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.files.wandb_log import WandbLog
from dronecombat_jax.runs.chunks import ChunkLog
from dronecombat_jax.runs.guards import write_dump
from dronecombat_jax.runs.records import progress_update, records
from dronecombat_jax.runs.saving import Saver
from dronecombat_jax.types import IterationMetrics, TrainState


class Keeper:
    """Writes the metrics and saves the states of one run; a context manager."""

    def __init__(self, run: RunDirectory, config: Config, saver: Saver, iteration: int):
        """`iteration`: done so far.

        Raises UserError 73 where a log cannot be opened, 2 where Weights & Biases is asked for and
        does not start.
        """
        self._config, self._saver = config, saver
        self._wandb: WandbLog | None = None
        with ExitStack() as stack:
            self.chunks = stack.enter_context(ChunkLog(config, run.chunks, run.metrics, iteration))
            steps = iteration * config.steps_per_iteration
            self._metrics = stack.enter_context(
                MetricsWriter(run.metrics, run.tensorboard, resume_steps=steps)
            )
            if config.run.wandb != "off":
                self._wandb = WandbLog(run.path, config)
                stack.callback(self._wandb.close)
            self._files = stack.pop_all()

    def __enter__(self) -> "Keeper":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._files.close()

    def write(self, report: IterationMetrics, iteration: int) -> None:
        """Record and show what one call reported, leaves NumPy [S, I, ...]; `iteration`: done
        before it.
        """
        for record in records(self._config, report, iteration):
            self._metrics.write(record)
            if self._wandb is not None:
                self._wandb.add(record)
            self.chunks.add(record)
        done = iteration + report.causes.shape[1]
        self._saver.progress.update(progress_update(self._config, report, done))

    def save(self, state: TrainState, ends_chunk: bool) -> None:
        """See the metrics to the disk, then the state, NumPy leaves [S, ...], that covers them."""
        self._metrics.sync()
        if ends_chunk:
            self.chunks.write(state.selfplay)
        with self.chunks.timed("saving"):
            self._saver.save(state)

    def fail(
        self, reason: str, state: TrainState, report: IterationMetrics, iteration: int
    ) -> None:
        """Dump the state of a training that diverged; raises UserError 4 that says where."""
        kept = write_dump(self._saver.run, state, report, iteration)
        raise UserError(
            f"training diverged: {reason}; {kept}, and the last checkpoint is intact", EXIT_DIVERGED
        )

    def finish(self) -> None:
        """Raise the error of a save that the disk refused, if no later save has succeeded."""
        self._saver.finish()


def timed(keeper: Keeper | None, what: str) -> AbstractContextManager[None]:
    """Count the block's seconds as `what` (`ChunkLog.timed`); without a keeper, nothing is counted."""
    return nullcontext() if keeper is None else keeper.chunks.timed(what)
