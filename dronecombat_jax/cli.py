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

from dronecombat_jax import flags, settings
from dronecombat_jax.config import Config, setting
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.schema import one_line, shown

DEFAULT_PRESET = "duel"
SHORT_FLAGS = {
    "run.name": "--name",
    "run.device": "--device",
    "train.seed": "--seed",
    "train.total_steps": "--steps",
}
EXIT_INTERRUPTED = 130
EXIT_BROKEN_PIPE = 141


@dataclass(frozen=True)
class TrainFlags(Config):
    """Train attacker and defender. Defaults < preset < flags."""

    preset: str = setting(DEFAULT_PRESET, f"one of {', '.join(settings.presets())}, or a .toml file")
    print_config: bool = setting(False, "print every setting as TOML and stop")


@dataclass(frozen=True)
class EvaluateFlags:
    """Let the two policies of a run fight and count who wins, how and when."""

    run: str = setting("", "the run: its folder, or its name in runs/")
    fights: int = setting(256, "number of fights", low=1, high=10**6)
    chunk: int = setting(-1, "which checkpoint, counted from the untrained one; -1: the newest", low=-1, high=10**9)
    seed: int = setting(0, "seed of the start states", low=0, high=2**31 - 1)
    stochastic: bool = setting(False, "draw the actions, as in training, instead of taking their mean")
    device: Literal["auto", "cpu", "gpu", "tpu"] = setting("auto", "where to compute")


@dataclass(frozen=True)
class DoctorFlags:
    """Say what this machine has and what is missing: versions, devices, rendering."""


def train(args: Sequence[str]) -> int:
    """train attacker and defender"""
    given, errors = flags.parse(TrainFlags, args, "dronecombat train", aliases=SHORT_FLAGS)
    preset, only_print = given.pop("preset", DEFAULT_PRESET), given.pop("print_config", False)
    try:
        config = settings.load(preset, given, check_memory=True)
    except UserError as error:
        raise UserError("\n".join([*errors, error.message])) from None
    if errors:
        raise UserError("\n".join(errors))
    config = replace(config, run=replace(config.run, name=settings.run_name(config, preset)))
    if only_print:
        print(settings.to_toml(config), end="")
        return 0
    print(summary(config, preset), flush=True)
    _prepare(config.run.device)
    from dronecombat_jax.runs import training

    if code := training.train(config):
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
    return evaluation.evaluate(run, given.fights, chunk=chunk, seed=given.seed, stochastic=given.stochastic)


def doctor(args: Sequence[str]) -> int:
    """say what this machine has and what is missing"""
    flags.read(DoctorFlags, args, "dronecombat doctor")
    from dronecombat_jax.doctor import doctor as examine

    return examine()


COMMANDS: dict[str, Callable[[Sequence[str]], int]] = {
    "train": train,
    "evaluate": evaluate,
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


def find_run(word: str) -> Path:
    """The folder of a run, given by its path or by its name in runs/; UserError where there is none."""
    if not word:
        raise UserError("RUN is missing: dronecombat evaluate RUN, RUN being a folder or a name in runs/")
    home = Path("runs")
    for folder in (Path(word), home / word):
        if os.path.isdir(folder):  # False, where Path raises on a name too long
            return folder
    names = sorted(path.name for path in home.iterdir() if path.is_dir()) if home.is_dir() else []
    close = difflib.get_close_matches(word, names, n=1)
    hint = f"did you mean {close[0]}?" if close else f"runs there are: {', '.join(names[:10]) or 'none'}"
    raise UserError(f"{word}: no such run; {hint}", EXIT_DATA)


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


def _prepare(device: str) -> None:
    """Choose the device and set XLA's flags: must come before JAX is imported."""
    from dronecombat_jax import backend

    backend.prepare(device)


if __name__ == "__main__":
    sys.exit(main())
