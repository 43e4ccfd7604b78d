"""`dronecombat train`: the host's side of a run. Claim the directory, compile once, go on until done.

The device does the work in program calls of a few iterations (`selfplay.chunk`); between two calls the
host writes metrics, answers signals and, at a chunk's end, saves. A run that was stopped or killed goes
on with the same command, bit for bit.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from dronecombat_jax import settings
from dronecombat_jax.config import Config
from dronecombat_jax.errors import EXIT_CANNOT_WRITE, EXIT_CONFIG, EXIT_DATA, EXIT_DIVERGED, EXIT_STOPPED, UserError
from dronecombat_jax.runs import checkpoint
from dronecombat_jax.runs.atomic import write_atomic
from dronecombat_jax.runs.metrics import MetricsWriter, truncate_after
from dronecombat_jax.runs.progress import Progress, make_progress
from dronecombat_jax.runs.records import progress_update, records
from dronecombat_jax.runs.rundir import RunDirectory, claim_run, rescue_run, still_there
from dronecombat_jax.runs.signals import StopFlag, stop_signals

# A program call is a few iterations: short enough to answer a signal within seconds on a laptop.
MAX_CALL_ITERATIONS = 5

# Settings that may change when a run goes on; every other one makes it a different run.
MAY_CHANGE = ("train.total_steps", "run.")

Advance = Callable[[Any], tuple[Any, Any]]


def train(config: Config) -> int:
    """Train, or go on with, the run that `config.run` names; returns an exit code.

    0: done; 75: stopped by a signal and saved. Raises UserError: 2 where the directory holds another
    run, 73 where it cannot be written, 3 for checkpoints that cannot be used, 4 where training diverged.
    """
    with claim_run(config.run.directory, config.run.name) as run:
        start = _last_iteration(run, config)
        last = config.num_chunks * config.train.chunk_iterations
        if start is not None and start >= last:
            done = start * config.steps_per_iteration
            print(f"run {run.name} is already complete: {done:,} environment steps per seed in {run.path}", flush=True)
            return 0
        write_atomic(run.config, settings.to_toml(config))
        _greet(run, config, start)
        total = last * config.steps_per_iteration * config.train.num_seeds
        done = (start or 0) * config.steps_per_iteration * config.train.num_seeds
        with make_progress(run.name, total, done) as progress, _stopping(progress) as stop:
            state, advance = _prepare(run, config, start, progress)
            return _run_chunks(run, config, state, advance, progress, stop)


def call_iterations(config: Config) -> int:
    """Iterations per program call: the largest divisor of a chunk that is at most 5."""
    return next(n for n in range(MAX_CALL_ITERATIONS, 0, -1) if config.train.chunk_iterations % n == 0)


def _last_iteration(run: RunDirectory, config: Config) -> int | None:
    """Where the run in this directory stopped; None for a new one. Needs no JAX."""
    if not run.config.exists():
        if checkpoint.steps(run.checkpoints):
            raise UserError(
                f"{run.config} is missing, though {run.checkpoints} holds checkpoints; choose another --name", EXIT_DATA
            )
        return None
    stored = settings.load(run.config, {})
    changed = [row for row in settings.diff(stored, config) if not row[0].startswith(MAY_CHANGE)]
    if changed:
        listed = "; ".join(f"{key} was {old!r}, now {new!r}" for key, old, new in changed)
        raise UserError(
            f"run {run.path} was made with other settings: {listed}. Choose another --name, or the old settings",
            EXIT_CONFIG,
        )
    return checkpoint.latest(run.checkpoints)


def _greet(run: RunDirectory, config: Config, start: int | None) -> None:
    from dronecombat_jax import backend

    print("\n".join(backend.banner()))
    planned = config.num_chunks * config.steps_per_chunk
    print(
        f"run {run.path}: {config.train.num_seeds} seed(s) x {planned:,} environment steps "
        f"({config.num_chunks} chunks of {config.steps_per_chunk:,}), {config.train.num_envs} environments"
    )
    if start is not None:
        print(f"resuming after {start * config.steps_per_iteration:,} environment steps per seed", flush=True)


@contextmanager
def _stopping(progress: Progress) -> Iterator[StopFlag]:
    announce = lambda name: progress.message(f"{name}: saving and stopping; once more to stop at once")
    with stop_signals(announce) as stop:
        yield stop


def _prepare(run: RunDirectory, config: Config, start: int | None, progress: Progress) -> tuple[Any, Advance]:
    """The state to go on from, on the device, and the compiled program."""
    import jax

    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.selfplay.chunk import build_advance, init_state

    combat = Combat(config)
    init = jax.jit(lambda: init_state(combat))
    if start is None:
        state = init()
        truncate_after(run.metrics, -1)
        _save(run, config, jax.device_get(state))  # before the compilation, which no signal can interrupt
    else:
        template = jax.eval_shape(init)
        state = jax.device_put(
            checkpoint.restore(
                run.checkpoints,
                start,
                template,
                hint="were learn.hidden_sizes, train.num_envs or train.num_seeds changed?",
            )
        )
        truncate_after(run.metrics, start * config.steps_per_iteration)
    with progress.compiling("the training program"):
        program = jax.jit(build_advance(combat, call_iterations(config)), donate_argnums=0).lower(state).compile()
    return state, program


def _run_chunks(
    run: RunDirectory, config: Config, state: Any, advance: Advance, progress: Progress, stop: StopFlag
) -> int:
    """Advance until done or asked to stop; returns the exit code."""
    import jax

    iteration, last = int(state.iteration[0]), config.num_chunks * config.train.chunk_iterations
    saver = _Saver(run, config, progress)
    stopping = bool(stop)
    with MetricsWriter(run.metrics, run.tensorboard, resume_steps=iteration * config.steps_per_iteration) as metrics:
        while iteration < last and not stopping:
            state, report = advance(state)
            report = jax.device_get(report)
            for record in records(config, report, iteration):
                metrics.write(record)
            iteration += call_iterations(config)
            progress.update(progress_update(config, report, iteration))
            _refuse_divergence(config, report, iteration)
            stopping = bool(stop)  # read once: what stops the loop must also have saved
            if iteration % config.train.chunk_iterations == 0 or stopping:
                metrics.sync()
                saver.save(jax.device_get(state))
    saver.finish()
    if iteration < last:
        done = iteration * config.steps_per_iteration
        progress.message(f"stopped after {done:,} environment steps per seed; the same command goes on")
        return EXIT_STOPPED
    return 0


class _Saver:
    """Saves at chunk boundaries. A disk that refuses is forgiven once; a directory that has gone is replaced."""

    def __init__(self, run: RunDirectory, config: Config, progress: Progress):
        self.run, self.config, self.progress = run, config, progress
        self.refused: UserError | None = None

    def save(self, state: Any) -> None:
        """Save `state` (NumPy leaves). Raises UserError 73 where the disk refuses twice running."""
        if not still_there(self.run):
            self.run = rescue_run(self.run)
            self.progress.message(f"the run's directory has gone; checkpoints go to {self.run.path} from now on")
            write_atomic(self.run.config, settings.to_toml(self.config))
        try:
            _save(self.run, self.config, state)
            self.refused = None
        except UserError as error:
            if error.exit_code != EXIT_CANNOT_WRITE or self.refused is not None:
                raise
            self.refused = error
            self.progress.message(f"warning: {error.message}; trying again at the next save")

    def finish(self) -> None:
        """Raise the refusal that no later save has made good."""
        if self.refused is not None:
            raise self.refused


def _save(run: RunDirectory, config: Config, state: Any) -> Path:
    """Write the checkpoint of `state` (NumPy leaves); its step is the number of iterations done."""
    iteration = int(state.iteration[0])
    meta = {"config": settings.to_toml(config), "steps": iteration * config.steps_per_iteration}
    return checkpoint.save(run.checkpoints, iteration, state, meta)


def _refuse_divergence(config: Config, report: Any, iteration: int) -> None:
    """Stop with exit code 4 where every gradient step of a program call had to be skipped."""
    skipped = np.asarray(report.learners.skipped)  # [S, I, A]
    steps = config.learn.epochs * config.learn.minibatches
    if math.prod(skipped.shape) and np.any(np.all(skipped >= steps, axis=1)):
        raise UserError(
            f"training diverged: not one finite gradient in iterations {iteration - skipped.shape[1]} to {iteration}; "
            "the last checkpoint is intact (a smaller learn.learning_rate may help)",
            EXIT_DIVERGED,
        )
