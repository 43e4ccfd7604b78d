"""`dronecombat evaluate` and `dronecombat export`: what is made from one run."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from dronecombat_jax.cli.start import prepare
from dronecombat_jax.config import flags
from dronecombat_jax.config.setting import setting
from dronecombat_jax.config.sides import MAX_TEAM
from dronecombat_jax.config.starts import STARTS
from dronecombat_jax.errors import UserError
from dronecombat_jax.files.rundir import find_run

POLICY_SUFFIXES = (".safetensors", ".onnx", ".h")


@dataclass(frozen=True)
class EvaluateFlags:
    """Let the two policies of a run fight and count who wins, how and when.

    The run's own evaluation is evaluation.json; with other options it is a file beside that. Such
    as

        dronecombat evaluate ippo
        dronecombat evaluate ippo --attacker dash --fights 1000
        dronecombat evaluate nearest-3v2 --defenders 4    (game.observation nearest)
    """

    run: str = setting("", "the run: its folder, or its name in runs/")
    fights: int = setting(0, "number of fights; 0: run.evaluation_fights", low=0, high=10**6)
    chunk: int = setting(
        -1, "which checkpoint, counted from the untrained one; -1: the newest", low=-1, high=10**9
    )
    seed: int = setting(0, "seed of the start states", low=0, high=2**31 - 1)
    stochastic: bool = setting(
        False, "draw the actions, as in training, instead of taking their mean"
    )
    defender: str = setting(
        "", "a scripted pilot in the defender's place, such as hover or hover_guard"
    )
    attacker: str = setting("", "a scripted pilot in the attacker's place, such as dash or weave")
    spawn: Literal["as_trained", "fixed", "uniform", "even"] = setting("as_trained", STARTS)
    defenders: int = setting(
        0,
        "drones of that side, in a team of another size than the run's; 0: as trained",
        low=0,
        high=MAX_TEAM,
    )
    attackers: int = setting(0, "the same of the other side", low=0, high=MAX_TEAM)
    device: Literal["auto", "cpu", "gpu", "tpu"] = setting("auto", "where to compute")


@dataclass(frozen=True)
class ExportFlags:
    """Write one policy of a run to one file: .safetensors (opens with NumPy alone), .onnx or .h.

    Such as

        dronecombat export ippo defender.safetensors --role defender
        dronecombat export ippo attacker.onnx --role attacker --chunk 12
        dronecombat export ippo policy.h --role attacker
        dronecombat export ippo-2v1 second.onnx --role defender --drone 2    (learn.mates own)
    """

    run: str = setting("", "the run: its folder, or its name in runs/")
    out: str = setting(
        "",
        "the file to write, ending in .safetensors, .onnx or .h (C99); also without --out, after RUN",
    )
    role: Literal["defender", "attacker"] = setting("attacker", "whose policy")
    chunk: int = setting(
        -1, "which checkpoint, counted from the untrained one; -1: the newest", low=-1, high=10**9
    )
    seed: int = setting(-1, "which of the run's seeds; -1: the only one", low=-1, high=2**31 - 1)
    drone: int = setting(
        0,
        "whose policy alone, where team mates have one each (learn.mates own): 1, 2, ...; 0: all, in one "
        ".safetensors file",
        low=0,
        high=MAX_TEAM,
    )
    force: bool = setting(False, "replace a file that is there already")


def evaluate(args: Sequence[str]) -> int:
    """let the policies of a run fight and count the outcomes"""
    given: EvaluateFlags = flags.read(EvaluateFlags, args, "dronecombat evaluate", positional="run")
    run = find_run(given.run)
    prepare(given.device)
    from dronecombat_jax.runs import evaluation

    chunk = None if given.chunk < 0 else given.chunk
    spawn = "" if given.spawn == "as_trained" else given.spawn
    match = evaluation.Match(
        given.fights,
        given.seed,
        given.stochastic,
        given.defender,
        given.attacker,
        spawn,
        given.defenders,
        given.attackers,
    )
    return evaluation.evaluate(run, match, chunk)


def export(args: Sequence[str]) -> int:
    """write one policy of a run to a file to share"""
    prog = "dronecombat export"
    given: ExportFlags = flags.read(ExportFlags, _with_out_named(args), prog, positional="run")
    out = Path(given.out)
    if out.suffix not in POLICY_SUFFIXES:
        raise UserError(
            f"the file to write must end in {' or '.join(POLICY_SUFFIXES)}: {prog} RUN policy.safetensors"
        )
    run = find_run(given.run)
    prepare("cpu")  # nothing is computed
    from dronecombat_jax.runs import export as exporter

    number = lambda value: None if value < 0 else value
    chunk, seed = number(given.chunk), number(given.seed)
    return exporter.export(
        run, out, given.role, chunk=chunk, seed=seed, drone=given.drone, force=given.force
    )


def _with_out_named(args: Sequence[str]) -> list[str]:
    """The words of `export RUN out.onnx` as `export RUN --out out.onnx`: known by its suffix, or by
    following RUN.
    """
    words: list[str] = []
    for word in args:
        second = len(words) == 1 and not words[0].startswith("-")
        bare = words and words[-1] != "--out" and not word.startswith("-")
        words += ["--out", word] if bare and (second or word.endswith(POLICY_SUFFIXES)) else [word]
    return words
