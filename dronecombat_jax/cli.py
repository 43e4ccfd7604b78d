"""The command line: `dronecombat COMMAND`. One function per command, one line in COMMANDS.

Commands read and check their flags before anything heavy is imported; JAX and MuJoCo are imported by
the rooms they call. A user's mistake is one line on stderr and an exit code (`errors`).
"""

import difflib
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from dronecombat_jax import flags, preflight, settings
from dronecombat_jax.config import Config, setting
from dronecombat_jax.errors import UserError
from dronecombat_jax.runs.rundir import find_run
from dronecombat_jax.schema import one_line, settings_of, shown
from dronecombat_jax.settings import Given

DEFAULT_PRESET = "duel"
SHORT_FLAGS = {
    "run.name": "--name",
    "run.device": "--device",
    "train.seed": "--seed",
    "train.total_steps": "--steps",
}
POLICY_SUFFIXES = (".safetensors", ".onnx")
EXIT_INTERRUPTED = 130
EXIT_BROKEN_PIPE = 141


@dataclass(frozen=True)
class TrainFlags(Config):
    """Train attacker and defender. Defaults < preset < flags."""

    preset: str = setting(DEFAULT_PRESET, f"one of {', '.join(settings.presets())}, or a .toml file")
    print_config: bool = setting(False, "print every setting as TOML and stop")
    fork: str = setting("", "name of a new run that begins from a checkpoint of the run --name, with other settings")
    fork_chunk: int = setting(-1, "which checkpoint to fork (0: the untrained one); -1: the newest", low=-1, high=10**9)


@dataclass(frozen=True)
class EvaluateFlags:
    """Let the two policies of a run fight and count who wins, how and when.

    The run's own evaluation is evaluation.json; with other options it is a file beside that.
    """

    run: str = setting("", "the run: its folder, or its name in runs/")
    fights: int = setting(0, "number of fights; 0: run.evaluation_fights", low=0, high=10**6)
    chunk: int = setting(-1, "which checkpoint, counted from the untrained one; -1: the newest", low=-1, high=10**9)
    seed: int = setting(0, "seed of the start states", low=0, high=2**31 - 1)
    stochastic: bool = setting(False, "draw the actions, as in training, instead of taking their mean")
    defender: str = setting("", "a scripted pilot in the defender's place, such as hover or hover_guard")
    attacker: str = setting("", "a scripted pilot in the attacker's place, such as dash or weave")
    spawn: Literal["as_trained", "fixed", "uniform"] = setting("as_trained", "where the fights start")
    device: Literal["auto", "cpu", "gpu", "tpu"] = setting("auto", "where to compute")


@dataclass(frozen=True)
class ExportFlags:
    """Write one policy of a run to one file: .safetensors (opens with NumPy alone) or .onnx."""

    run: str = setting("", "the run: its folder, or its name in runs/")
    out: str = setting("", "the file to write, ending in .safetensors or .onnx; also without --out, after RUN")
    role: Literal["defender", "attacker"] = setting("attacker", "whose policy")
    chunk: int = setting(-1, "which checkpoint, counted from the untrained one; -1: the newest", low=-1, high=10**9)
    seed: int = setting(-1, "which of the run's seeds; -1: the only one", low=-1, high=2**31 - 1)
    force: bool = setting(False, "replace a file that is there already")


@dataclass(frozen=True)
class TournamentFlags:
    """Every attacker against every defender of the ENTRANTS before the flags, and how they rate.

    An entrant is a run (its folder, or its name in runs/), a policy file (.safetensors), scripted:NAME or scripted:all.
    """

    episodes: int = setting(5, "fights of each pair; fight e starts alike for all pairs", low=1, high=10**5)
    every: int = setting(1, "of a run every n-th chunk, and the last", low=1, high=10**6)
    untrained: bool = setting(False, "of a run also the players that it began with; the paper's are chunk ends alone")
    name: str = setting("", "folder in tournaments/ (default: the names of the runs)")
    seed: int = setting(0, "seed of the start states", low=0, high=2**31 - 1)
    stochastic: bool = setting(False, "draw the actions, as in training, instead of taking their mean")
    flights: int = setting(0, "fights to record of each run's two sides of one chunk: how they fly", low=0, high=10**4)
    mjcf: str = setting("", "the MJCF that was trained with, where no run says where it is")
    skip_bad: bool = setting(False, "leave out what cannot be read, and exit with 5")
    allow_env_mismatch: bool = setting(False, "let policies of another game fly in that of the first")
    device: Literal["auto", "cpu", "gpu", "tpu"] = setting("auto", "where to compute")


@dataclass(frozen=True)
class ReportFlags:
    """Draw a tournament: the paper's figures and more, tables, and one page that shows them all."""

    tournament: str = setting("", "the tournament: its folder, its name in tournaments/, or a result file")
    out: str = setting("", "folder to write to (default: report/ in the tournament's folder)")


@dataclass(frozen=True)
class CompareFlags:
    """Does one method's final defender beat another's? All RUNS before the flags meet in one tournament.

    Every RUN is a folder, or a name in runs/. The scripted pilots take part as anchors. Flown is what the answer and
    its figures rest on: final defenders against everybody, each run against itself, scripted pilots against final ones.
    """

    by: str = setting("method", "what parts the runs: method, preset, run, or a setting such as train.total_steps")
    tournament: str = setting("", "its folder in tournaments/ (default: compare- and the runs); alone: judge it again")
    every: int = setting(10, "a run's attackers on the panel: every n-th chunk's, and the last", low=1, high=10**6)
    episodes: int = setting(50, "fights of each pair", low=1, high=10**5)
    seed: int = setting(0, "seed of the start states", low=0, high=2**31 - 1)
    stochastic: bool = setting(False, "draw the actions, as in training, instead of taking their mean")
    skip_bad: bool = setting(False, "leave out what cannot be read, and exit with 5")
    allow_env_mismatch: bool = setting(False, "let policies of another game fly in that of the first")
    device: Literal["auto", "cpu", "gpu", "tpu"] = setting("auto", "where to compute")


@dataclass(frozen=True)
class ReplayFlags:
    """Fly fights and write one page that replays them in a browser: no server, no network, no other file.

    Before the flags: a RUN (its folder, or its name in runs/), policy files (.safetensors), or scripted:NAME. Such as
    `dronecombat replay ippo`, `dronecombat replay ippo --defender hover_guard --attacker 12`, `dronecombat replay ippo
    --evolution`, `dronecombat replay --defender hover --attacker dash --out fight.gif`.
    """

    defender: str = setting(
        "", "who defends: a chunk of RUN, a scripted pilot, a policy file, another run or RUN:CHUNK"
    )
    attacker: str = setting("", "who attacks, likewise; without it the newest of RUN, or the file's")
    fights: int = setting(9, "how many fights, side by side; a film shows the first", low=1, high=16)
    seed: int = setting(0, "seed of the start states; fight e starts as in a tournament", low=0, high=2**31 - 1)
    evolution: bool = setting(False, "one start, flown by the policies of 0 %, 10 %, ... 100 % of RUN's training")
    out: str = setting("", "the file: .html, or a film .mp4, .gif, .webp (default: replay.html in RUN's folder)")
    open: bool = setting(False, "open the page in a browser, where there is one")
    run_seed: int = setting(-1, "which of the run's seeds; -1: its first", low=-1, high=2**31 - 1)
    stochastic: bool = setting(False, "draw the actions, as in training, instead of taking their mean")
    spawn: Literal["as_trained", "fixed", "uniform"] = setting("as_trained", "where the fights start")
    allow_env_mismatch: bool = setting(False, "let policies of another game fly in that of the first")
    device: Literal["auto", "cpu", "gpu", "tpu"] = setting("auto", "where to compute")


@dataclass(frozen=True)
class DoctorFlags:
    """Say what this machine has and what is missing, or how a drone's file is flown."""

    mjcf: str = setting("", "an MJCF: how its drone is flown, side by side with C MuJoCo")


def train(args: Sequence[str]) -> int:
    """train attacker and defender"""
    given, errors = flags.parse(TrainFlags, args, "dronecombat train", aliases=SHORT_FLAGS)
    preset, only_print = given.pop("preset", DEFAULT_PRESET), given.pop("print_config", False)
    fork = {key: given.pop(key) for key in ("fork", "fork_chunk") if key in given}
    own = {key: Given(value, settings.flag(key)) for key, value in fork.items()}
    errors += settings.check(own, settings_of(TrainFlags))
    if "fork" not in fork and fork:
        errors.append("--fork-chunk needs --fork NEW_NAME")
    try:
        config = settings.load(preset, given, check_machine=True)
    except UserError as error:
        raise UserError("\n".join([*errors, error.message])) from None
    if errors:
        raise UserError("\n".join(errors))
    config = replace(config, run=replace(config.run, name=settings.run_name(config, preset)))
    if config.sim.mjcf:  # a run is gone on with, and looked at, from any folder
        whole = Path(config.sim.mjcf).expanduser().absolute()
        config = replace(config, sim=replace(config.sim, mjcf=str(whole)))
    if only_print:
        print(settings.to_toml(config), end="")
        return 0
    print(summary(config, preset), flush=True)
    _prepare(config.run.device, config)
    if config.sim.mjcf:  # what cannot be flown is said before there is a folder
        from dronecombat_jax.sim.scene import load_scene

        load_scene(config.sim)
    from dronecombat_jax import processes
    from dronecombat_jax.runs import training

    with processes.parting():
        if "fork" in fork:
            new = replace(config, run=replace(config.run, name=fork["fork"]))
            chunk = fork.get("fork_chunk", -1)
            config, code = new, training.train(new, config.run.name, chunk if chunk >= 0 else None)
        else:
            code = training.train(config)
    if code or not processes.first():
        return code
    from dronecombat_jax.report import finish

    finish.finish(config)
    return 0


def evaluate(args: Sequence[str]) -> int:
    """let the policies of a run fight and count the outcomes"""
    given: EvaluateFlags = flags.read(EvaluateFlags, args, "dronecombat evaluate", positional="run")
    run = find_run(given.run)
    _prepare(given.device)
    from dronecombat_jax.runs import evaluation

    chunk = None if given.chunk < 0 else given.chunk
    spawn = "" if given.spawn == "as_trained" else given.spawn
    match = evaluation.Match(given.fights, given.seed, given.stochastic, given.defender, given.attacker, spawn)
    return evaluation.evaluate(run, match, chunk)


def export(args: Sequence[str]) -> int:
    """write one policy of a run to a file to share"""
    prog = "dronecombat export"
    given: ExportFlags = flags.read(ExportFlags, _with_out_named(args), prog, positional="run")
    out = Path(given.out)
    if out.suffix not in POLICY_SUFFIXES:
        raise UserError(f"the file to write must end in {' or '.join(POLICY_SUFFIXES)}: {prog} RUN policy.safetensors")
    run = find_run(given.run)
    _prepare("cpu")  # nothing is computed
    from dronecombat_jax.runs import export as exporter

    number = lambda value: None if value < 0 else value
    chunk, seed = number(given.chunk), number(given.seed)
    return exporter.export(run, out, given.role, chunk=chunk, seed=seed, force=given.force)


def tournament(args: Sequence[str]) -> int:
    """every attacker against every defender, and how they rate"""
    prog = "dronecombat tournament"
    words, rest = _split_words(args, TournamentFlags)
    given: TournamentFlags = flags.read(TournamentFlags, rest, prog)
    if not words:
        raise UserError(
            f"nobody is named: {prog} ENTRANT [ENTRANT ...], such as a run, scripted:all, policy.safetensors"
        )
    _rate_on_one_core()
    _prepare(given.device)
    from dronecombat_jax.arena.rectangle import Rules
    from dronecombat_jax.runs import tournament as tournaments

    rules = Rules(given.episodes, given.seed, given.stochastic)
    return tournaments.tournament(
        words,
        rules,
        name=given.name,
        every=given.every,
        untrained=given.untrained,
        flights=given.flights,
        mjcf=given.mjcf,
        skip_bad=given.skip_bad,
        allow_mismatch=given.allow_env_mismatch,
    )


def report(args: Sequence[str]) -> int:
    """draw a tournament: figures, tables and one page"""
    given: ReportFlags = flags.read(ReportFlags, args, "dronecombat report", positional="tournament")
    _rate_on_one_core()
    _prepare("cpu")
    from dronecombat_jax.report import tournament_report

    return tournament_report.report(given.tournament, Path(given.out) if given.out else None)


def compare(args: Sequence[str]) -> int:
    """does one method's final defender beat another's?"""
    words, rest = _split_words(args, CompareFlags)
    given: CompareFlags = flags.read(CompareFlags, rest, "dronecombat compare")
    _rate_on_one_core()
    _prepare(given.device)
    from dronecombat_jax.arena.rectangle import Rules
    from dronecombat_jax.report import comparison

    return comparison.compare(
        words,
        Rules(given.episodes, given.seed, given.stochastic),
        by=given.by,
        name=given.tournament,
        every=given.every,
        skip_bad=given.skip_bad,
        allow_mismatch=given.allow_env_mismatch,
    )


def replay(args: Sequence[str]) -> int:
    """fights on one page that any browser plays, or as a film"""
    words, rest = _split_words(args, ReplayFlags)
    given: ReplayFlags = flags.read(ReplayFlags, rest, "dronecombat replay")
    _prepare(given.device)
    from dronecombat_jax.report import replay as room
    from dronecombat_jax.runs.flyers import Named
    from dronecombat_jax.runs.recording import Filming

    spawn = "" if given.spawn == "as_trained" else given.spawn
    return room.replay(
        Named(tuple(words), (given.defender, given.attacker), given.run_seed, given.allow_env_mismatch),
        Filming(given.fights, given.seed, given.stochastic, spawn),
        out=Path(given.out) if given.out else None,
        evolution=given.evolution,
        browser=given.open,
    )


def doctor(args: Sequence[str]) -> int:
    """say what this machine has and what is missing"""
    given: DoctorFlags = flags.read(DoctorFlags, args, "dronecombat doctor")
    from dronecombat_jax import doctor as examiner

    return examiner.doctor_mjcf(given.mjcf) if given.mjcf else examiner.doctor()


COMMANDS: dict[str, Callable[[Sequence[str]], int]] = {
    "train": train,
    "evaluate": evaluate,
    "export": export,
    "tournament": tournament,
    "report": report,
    "compare": compare,
    "replay": replay,
    "doctor": doctor,
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; the entry point of `dronecombat`."""
    args = list(sys.argv[1:] if argv is None else argv)
    try:
        return _run(args)
    except UserError as error:
        for line in error.message.splitlines():
            print(f"error: {line}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # the reader has gone: `dronecombat train --help | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return EXIT_BROKEN_PIPE


def usage() -> str:
    """What `dronecombat --help` prints."""
    lines = [f"  {name:<10} {(command.__doc__ or '').splitlines()[0]}" for name, command in COMMANDS.items()]
    return "\n".join(
        ["usage: dronecombat COMMAND [flags]", "", *lines, "", "dronecombat COMMAND --help explains the flags."]
    )


def summary(config: Config, preset: str) -> str:
    """The settings that differ from the defaults, one line each, and how to see the rest."""
    lines = [f"settings: preset {preset}; these differ from the defaults:"]
    for key, default, value in settings.diff(Config(), config):
        lines.append(f"  {key} = {shown(value)} (default {shown(default)})")
    return "\n".join([*lines, "  (all of them: the same command with --print-config)"])


def _with_out_named(args: Sequence[str]) -> list[str]:
    """The words of `export RUN out.onnx` as `export RUN --out out.onnx`: known by its suffix, or by following RUN."""
    words: list[str] = []
    for word in args:
        second = len(words) == 1 and not words[0].startswith("-")
        bare = words and words[-1] != "--out" and not word.startswith("-")
        words += ["--out", word] if bare and (second or word.endswith(POLICY_SUFFIXES)) else [word]
    return words


def _split_words(args: Sequence[str], cls: type) -> tuple[list[str], list[str]]:
    """The words that belong to no flag of `cls`, in order, and everything else."""
    with_value = {settings.flag(key) for key, entry in settings_of(cls).items() if entry.kind != "bool"}
    words: list[str] = []
    rest: list[str] = []
    for word in args:
        value = bool(rest) and rest[-1].replace("_", "-") in with_value
        (rest if value or word.startswith("-") else words).append(word)
    return words, rest


def _run(args: list[str]) -> int:
    if not args or args[0] in ("-h", "--help", "help"):
        print(usage())
        return 0 if args else 2
    name = args[0]
    if name not in COMMANDS:
        close = difflib.get_close_matches(name, COMMANDS, n=1)
        hint = f"did you mean {close[0]}?" if close else f"commands: {', '.join(COMMANDS)}"
        raise UserError(f"{one_line(name)}: unknown command; {hint}")
    try:
        return COMMANDS[name](args[1:])
    except SystemExit as stop:  # tyro, after --help
        if stop.code:
            raise
        return 0


def _rate_on_one_core() -> None:
    """Ratings solve small systems: OpenBLAS's second thread waits a hundred times their length on a busy machine."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when NumPy is imported


def _prepare(device: str, config: Config | None = None) -> None:
    """Choose the device and set XLA's flags: must come before JAX is imported."""
    from dronecombat_jax import backend

    if config is None:
        return backend.prepare(device, 1)
    if config.run.matmul_precision != "default":
        backend.set_matmul_precision(config.run.matmul_precision)
    if config.run.distributed:
        from dronecombat_jax import processes

        return backend.prepare(device, 1, lambda: processes.join(config.run.join_seconds))
    seeds, environments = preflight.mesh_shape(config.train.num_seeds, config.run.devices, backend.cores())
    backend.prepare(device, seeds * environments)


if __name__ == "__main__":
    from dronecombat_jax import __main__ as program

    sys.exit(program.main())
