"""`dronecombat train`: the host's side of a run. Claim the directory, compile once, go on until done.

The device does the work in program calls of a few iterations (`selfplay.chunk`); between two calls the
host writes metrics, answers signals and, at a chunk's end, saves. A run that was stopped or killed goes
on with the same command, bit for bit.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from dronecombat_jax import settings
from dronecombat_jax.config import Config
from dronecombat_jax.errors import EXIT_DIVERGED, EXIT_STOPPED, UserError
from dronecombat_jax.runs import fork
from dronecombat_jax.runs.atomic import write_atomic
from dronecombat_jax.runs.chunks import ChunkLog
from dronecombat_jax.runs.claim import claim_run
from dronecombat_jax.runs.guards import Watch, device_errors, write_dump
from dronecombat_jax.runs.metrics import MetricsWriter, truncate_after
from dronecombat_jax.runs.program import call_iterations, flight_seconds, seed_devices
from dronecombat_jax.runs.progress import Progress, make_progress
from dronecombat_jax.runs.provenance import check_meta
from dronecombat_jax.runs.records import progress_update, records
from dronecombat_jax.runs.resume import Start, find_start, restored_state
from dronecombat_jax.runs.rundir import RunDirectory, run_path
from dronecombat_jax.runs.saving import Saver
from dronecombat_jax.runs.signals import StopFlag, stop_signals

Advance = Callable[[Any], tuple[Any, Any]]


def train(config: Config, fork_of: str | None = None, chunk: int | None = None) -> int:
    """Train, or go on with, the run that `config.run` names; returns an exit code.

    `fork_of`: a run in the same folder; a new run begins from its checkpoint of `chunk` (None: the newest).
    0: done; 75: stopped by a signal and saved. Raises UserError: 2 where the directory holds another
    run, 73 where it cannot be written, 3 for checkpoints that cannot be used, 4 where training diverged.
    """
    source = None if fork_of is None else RunDirectory(run_path(config.run.directory, fork_of))
    forked = None if source is None else fork.fork_start(source, chunk, config)
    with claim_run(config.run.directory, config.run.name) as run:
        start = find_start(run, config)
        last = _last_iteration(config)
        if start is not None and source is not None:
            fork.check_origin(run, start, source)
        if start is not None and start.iteration >= last:
            done = start.iteration * config.steps_per_iteration
            print(f"run {run.name} is already complete: {done:,} environment steps per seed in {run.path}", flush=True)
            return 0
        start = start or forked
        write_atomic(run.config, settings.to_toml(config))
        _greet(run, config, start)
        iteration = start.iteration if start else 0
        steps = config.steps_per_iteration * config.train.num_seeds
        with make_progress(run.name, last * steps, iteration * steps) as progress, _stopping(progress) as stop:
            saver = Saver(run, config, progress, _inherited(start, source))
            with device_errors():
                return _run(run, config, start, saver, stop)


def _greet(run: RunDirectory, config: Config, start: Start | None) -> None:
    from dronecombat_jax import backend

    print("\n".join(backend.banner()))
    planned = config.num_chunks * config.steps_per_chunk
    print(
        f"run {run.path}: {config.train.num_seeds} seed(s) x {planned:,} environment steps "
        f"({config.num_chunks} chunks of {config.steps_per_chunk:,}), {config.train.num_envs} environments"
    )
    if start is None:
        return
    done = f"{start.iteration * config.steps_per_iteration:,} environment steps per seed"
    if start.changed:
        print(f"forked from {start.path} after {done}; changed:", *start.changed, sep="\n  ", flush=True)
    else:
        print(f"resuming after {done}", flush=True)


def _inherited(start: Start | None, source: RunDirectory | None) -> dict[str, Any]:
    """What every checkpoint of this run says of where it came from."""
    if start is not None and start.changed and source is not None:
        return {"forked": fork.origin(source, start)}
    forked = start.meta.get("forked") if start is not None else None
    return {"forked": forked} if forked else {}


@contextmanager
def _stopping(progress: Progress) -> Iterator[StopFlag]:
    announce = lambda name: progress.message(f"{name}: saving and stopping; once more to stop at once")
    with stop_signals(announce) as stop:
        yield stop


def _run(run: RunDirectory, config: Config, start: Start | None, saver: Saver, stop: StopFlag) -> int:
    """Prepare, then advance until done or asked to stop; returns the exit code."""
    state, compile_program = _prepare(run, config, start, saver)
    iteration = int(state.iteration[0])
    with (
        ChunkLog(config, run.chunks, run.metrics, iteration) as chunks,
        MetricsWriter(run.metrics, run.tensorboard, resume_steps=iteration * config.steps_per_iteration) as metrics,
    ):
        with chunks.timed("compile"), saver.progress.compiling("the training program"):
            advance = compile_program(state)
        iteration = _advance(config, state, advance, metrics, chunks, saver, stop)
    if iteration == _last_iteration(config):
        return 0
    done = iteration * config.steps_per_iteration
    saver.progress.message(f"stopped after {done:,} environment steps per seed; the same command goes on")
    return EXIT_STOPPED


def _prepare(
    run: RunDirectory, config: Config, start: Start | None, saver: Saver
) -> tuple[Any, Callable[[Any], Advance]]:
    """The state to go on from, on the device and on the disk, and a function that compiles the program for it."""
    import jax

    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.selfplay.chunk import SEEDS, build_advance, init_state

    combat = Combat(config)
    if start is None:
        state = jax.jit(lambda: init_state(combat))()
    else:
        for note in check_meta(start, config):
            saver.progress.message(note)
        state = (fork.forked_state if start.changed else restored_state)(start, config, combat)
    if start is None or start.changed:
        saver.save_now(jax.device_get(state))  # before the compilation, which no signal can interrupt
    steps = int(state.iteration[0]) * config.steps_per_iteration if start else -1
    for log in (run.metrics, run.chunks):
        truncate_after(log, steps)
    mesh = seed_devices(config)
    program = jax.jit(build_advance(combat, call_iterations(config), mesh), donate_argnums=0)
    where = jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec(SEEDS)) if mesh else None
    return jax.device_put(jax.device_get(state), where), lambda state: program.lower(state).compile()


def _advance(
    config: Config,
    state: Any,
    advance: Advance,
    metrics: MetricsWriter,
    chunks: ChunkLog,
    saver: Saver,
    stop: StopFlag,
) -> int:
    """Call the program until all is done or a stop is asked for, and save; returns the iterations done."""
    import jax

    iteration, watch = int(state.iteration[0]), Watch(config)
    stopping = bool(stop)
    while iteration < _last_iteration(config) and not stopping:
        with chunks.timed("program"):
            state, report = advance(state)
            report = jax.device_get(report)
        for record in records(config, report, iteration):
            metrics.write(record)
            chunks.add(record)
        reason = watch.verdict(report, iteration)
        iteration += call_iterations(config)
        saver.progress.update(progress_update(config, report, iteration))
        if reason:
            kept = write_dump(saver.run, jax.device_get(state), report, iteration)
            raise UserError(f"training diverged: {reason}; {kept}, and the last checkpoint is intact", EXIT_DIVERGED)
        stopping = bool(stop)  # read once: what stops the loop must also have saved
        ends_chunk = iteration % config.train.chunk_iterations == 0
        if ends_chunk or stopping:
            state_here = jax.device_get(state)
            metrics.sync()
            if ends_chunk:
                chunks.flight = chunks.flight or flight_seconds(config, state)
                chunks.write(state_here.selfplay)
            with chunks.timed("saving"):
                saver.save(state_here)
    saver.finish()
    return iteration


def _last_iteration(config: Config) -> int:
    return config.num_chunks * config.train.chunk_iterations
