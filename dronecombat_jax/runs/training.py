"""`dronecombat train`: the host's side of a run. Claim the directory, compile once, go on until
done.

The device does the work in program calls of a few iterations (`selfplay.chunk`); between two calls
the host writes metrics, answers signals and, at a chunk's end, saves (`keeper`). A run that was
stopped or killed goes on with the same command, bit for bit. Of several processes only the first
has a run directory; all run this loop.
"""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dronecombat_jax.config import estimates, settings
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.opponents import described
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_STOPPED, UserError
from dronecombat_jax.files.atomic import write_atomic
from dronecombat_jax.files.checkpoint import steps
from dronecombat_jax.files.claim import claim_run
from dronecombat_jax.files.metrics import truncate_after
from dronecombat_jax.files.rundir import RunDirectory, run_path
from dronecombat_jax.machine import processes
from dronecombat_jax.runs import fork
from dronecombat_jax.runs.guards import Watch, device_errors
from dronecombat_jax.runs.keeper import Keeper, timed
from dronecombat_jax.runs.program import Advance, Program
from dronecombat_jax.runs.progress import Progress, make_progress
from dronecombat_jax.runs.provenance import check_meta
from dronecombat_jax.runs.resume import Start, find_start, restored_state
from dronecombat_jax.runs.saving import Saver
from dronecombat_jax.runs.signals import StopFlag, stop_signals

if TYPE_CHECKING:
    from dronecombat_jax.runs.opponents import Frozen


class Begun(NamedTuple):
    """A run that this process has claimed, and where it goes on from."""

    run: RunDirectory
    start: Start | None
    more_meta: dict[str, Any]  # for every checkpoint
    complete: bool  # nothing is left to do
    frozen: "Frozen | None" = None  # the policies of the table of opponents


def train(config: Config, fork_of: str | None = None, chunk: int | None = None) -> int:
    """Train, or go on with, the run that `config.run` names; returns an exit code.

    `fork_of`: a run in the same folder; a new run begins from its checkpoint of `chunk` (None: the
    newest). 0: done; 75: stopped by a signal and saved. Raises UserError: 2 where the directory
    holds another run, 73 where it cannot be written, 3 for checkpoints that cannot be used, 4 where
    training diverged.
    """
    with ExitStack() as stack:
        with processes.together():
            if not processes.agreed(f"{settings.to_toml(config)} {fork_of} {chunk}"):
                raise UserError(
                    "run.distributed: the processes were started with different settings",
                    EXIT_CONFIG,
                )
            begun = _begin(stack, config, fork_of, chunk) if processes.first() else None
        if processes.anywhere(begun is not None and begun.complete):
            return 0
        with device_errors():
            if begun is None:
                stop = stack.enter_context(stop_signals())
                code = _run(None, config, stop)
            else:
                steps = config.steps_per_iteration * config.train.num_seeds
                done = begun.start.iteration if begun.start else 0
                total = _last_iteration(config) * steps
                progress = stack.enter_context(make_progress(begun.run.name, total, done * steps))
                stop = stack.enter_context(_stopping(progress))
                saver = Saver(begun.run, config, progress, begun.more_meta)
                saver.frozen = begun.frozen
                code = _run(begun, config, stop, saver)
    return EXIT_STOPPED if stop else code  # a signal may have come after the last look at it


def _begin(stack: ExitStack, config: Config, fork_of: str | None, chunk: int | None) -> Begun:
    """Claim the run for as long as `stack` is open, find out where it goes on from, and say so."""
    source = None if fork_of is None else RunDirectory(run_path(config.run.directory, fork_of))
    forked = None if source is None else fork.fork_start(source, chunk, config)
    frozen = _read_opponents(config)
    if any(config.learn.teachers):
        from dronecombat_jax.combat.scripted import check_teachers

        check_teachers(config)
    run = stack.enter_context(claim_run(config.run.directory, config.run.name))
    start = find_start(run, config)
    if start is not None and source is not None:
        fork.check_origin(run, start, source)
    complete = start is not None and start.iteration >= _last_iteration(config)
    if start is not None and complete:
        done = start.iteration * config.steps_per_iteration
        print(
            f"run {run.name} is already complete: {done:,} environment steps per seed in {run.path}",
            flush=True,
        )
    else:
        if config.selfplay.opponents:
            frozen = _kept_opponents(run, config, start, frozen)
        start = start or forked
        write_atomic(run.config, settings.to_toml(config))
        _greet(run, config, start, frozen)
    more_meta = _inherited(start, source) | (frozen.meta if frozen else {})
    return Begun(run, start, more_meta, complete, frozen)


def _read_opponents(config: Config) -> "Frozen | None":
    """The policies that a new run names, read before it has a folder; None where it has one."""
    path = RunDirectory(run_path(config.run.directory, config.run.name))
    if not config.selfplay.opponents or steps(path.checkpoints):
        return None
    from dronecombat_jax.runs.opponents import read_named

    return read_named(config)


def _kept_opponents(
    run: RunDirectory, config: Config, start: Start | None, named: "Frozen | None"
) -> "Frozen":
    """The opponents of a claimed run: the copies in its folder or, for a new run, those `named`."""
    from dronecombat_jax.runs import opponents

    if start is not None:
        return opponents.read_kept(run, config, start.meta)
    frozen = named or opponents.read_named(config)
    opponents.keep(run, frozen)
    return frozen


def _greet(run: RunDirectory, config: Config, start: Start | None, frozen: "Frozen | None") -> None:
    from dronecombat_jax.machine import backend

    print("\n".join(backend.banner()))
    planned = config.num_chunks * config.steps_per_chunk
    print(
        f"run {run.path}: {config.train.num_seeds} seed(s) x {planned:,} environment steps "
        f"({config.num_chunks} chunks of {config.steps_per_chunk:,}), {config.train.num_envs} environments"
    )
    disk = estimates.estimated_disk_bytes(config)
    print(
        f"disk: about {estimates.bytes_in_words(disk)} by its end (run.keep = {config.run.keep!r})",
        flush=True,
    )
    if config.selfplay.opponents:
        lines = described(config) + (frozen.lines if frozen else [])
        print("opponents:", *lines, sep="\n  ", flush=True)
    if start is None:
        return
    done = f"{start.iteration * config.steps_per_iteration:,} environment steps per seed"
    if start.changed:
        print(
            f"forked from {start.path} after {done}; changed:",
            *start.changed,
            sep="\n  ",
            flush=True,
        )
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
    announce = lambda name: progress.message(
        f"{name}: saving and stopping; once more to stop at once"
    )
    with stop_signals(announce) as stop:
        yield stop


def _run(begun: Begun | None, config: Config, stop: StopFlag, saver: Saver | None = None) -> int:
    """Prepare, then advance until done or asked to stop; returns the exit code. Without a run that
    has `begun`: write nothing.
    """
    run = begun.run if begun else None
    program, state = _prepare(begun, config, saver)
    iteration = int(processes.on_host(state.iteration)[0])
    with ExitStack() as stack:
        with processes.together():
            keeper = Keeper(run, config, saver, iteration) if run and saver else None
            stack.enter_context(keeper or nullcontext())
        shown = saver.progress.compiling("the training program") if saver else nullcontext()
        with processes.together(), timed(keeper, "compile"), shown:
            advance = program.compile(state)
        iteration = _advance(program, state, iteration, advance, keeper, stop)
    if iteration == _last_iteration(config) and not stop:
        return 0
    if saver:
        done = iteration * config.steps_per_iteration
        saver.progress.message(
            f"stopped after {done:,} environment steps per seed; the same command goes on"
        )
    return EXIT_STOPPED


def _prepare(begun: Begun | None, config: Config, saver: Saver | None) -> tuple[Program, Any]:
    """The program of the run, and the state to go on from, on the devices and on the disk."""
    import jax

    from dronecombat_jax.combat.fingerprint import environment
    from dronecombat_jax.selfplay.chunk import init_state
    from dronecombat_jax.selfplay.mesh import place

    with processes.together():
        program = Program(config, begun.frozen if begun else None)
        combat = program.combat
        if begun and saver:
            saver.met = environment(config, combat.scene)
            state = _first_state(begun.run, config, begun.start, saver, combat)
        else:  # of the same shapes, to be filled by the first process
            shapes = jax.eval_shape(lambda: init_state(combat))
            state = jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), shapes)
    return program, place(processes.from_first(state), program.mesh)


def _first_state(
    run: RunDirectory, config: Config, start: Start | None, saver: Saver, combat: Any
) -> Any:
    """The state to go on from, NumPy leaves [S, ...]; a new run's is saved, and the logs end where
    it is.
    """
    import jax

    from dronecombat_jax.selfplay.chunk import init_state

    if start is None:
        state = jax.jit(lambda: init_state(combat))()
    else:
        for note in check_meta(start, config, saver.met):
            saver.progress.message(note)
        state = (fork.forked_state if start.changed else restored_state)(start, config, combat)
    state = jax.device_get(state)
    if start is None or start.changed:
        saver.save_now(state)  # before the compilation, which no signal can interrupt
    steps = int(state.iteration[0]) * config.steps_per_iteration if start else -1
    for log in (run.metrics, run.chunks):
        truncate_after(log, steps)
    return state


def _advance(
    program: Program,
    state: Any,
    iteration: int,
    advance: Advance,
    keeper: Keeper | None,
    stop: StopFlag,
) -> int:
    """Call the program until all is done or a stop is asked for, and save; returns the iterations
    done.
    """
    config = program.config
    watch = Watch(config)
    stopping, flight = processes.anywhere(bool(stop)), None
    while iteration < _last_iteration(config) and not stopping:
        with timed(keeper, "program"):
            state, report = advance(state)
            report = processes.on_host(report)
        before, iteration = iteration, iteration + program.iterations
        reason = watch.verdict(report, before)
        # asked once: what stops the loop must also have saved
        stopping = processes.anywhere(bool(stop))
        ends_chunk = iteration % config.train.chunk_iterations == 0
        here: Any = processes.on_host(state) if ends_chunk or stopping or reason else None
        if ends_chunk and not reason:
            flight = flight or program.flight_seconds(state)
        with processes.together():
            if keeper is not None:
                keeper.write(report, before)
                keeper.chunks.flight = flight
                if reason:
                    keeper.fail(reason, here, report, iteration)
                if ends_chunk or stopping:
                    keeper.save(here, ends_chunk)
    with processes.together():
        if keeper is not None:
            keeper.finish()
    return iteration


def _last_iteration(config: Config) -> int:
    return config.num_chunks * config.train.chunk_iterations
