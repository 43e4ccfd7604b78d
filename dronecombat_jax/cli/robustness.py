"""`dronecombat robustness`."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from dronecombat_jax.cli.start import prepare, rate_on_one_core
from dronecombat_jax.cli.words import split_words
from dronecombat_jax.config import flags
from dronecombat_jax.config.setting import setting
from dronecombat_jax.errors import UserError


@dataclass(frozen=True)
class RobustnessFlags:
    """How do the players fare on a drone that is not the one they were trained with?

    WORDS before the flags are one finished tournament (its folder, or its name in tournaments/), or
    entrants as `dronecombat tournament` takes them. Their matrix is flown again under each gap: mass,
    thrust, the rotors' limits and lag, drag, noise, latency. Each side has each gap alone, where
    that can be, against the other side without it. Written are the loss of score with its interval
    and the rank correlation of the ratings: JSON, a table and a picture, in robustness/ of the
    tournament's folder. The same command again goes on where it was stopped. Such as

        dronecombat robustness ippo-sippo
        dronecombat robustness ippo scripted:all --every 10 --episodes 20
        dronecombat robustness pilots:all --gaps mass_plus,latency_40
    """

    gaps: str = setting(
        "",
        "which gaps, with commas between: other_starts, mass_plus, mass_minus, thrust_minus, limits, "
        "lag, drag, noise, latency_20, latency_40, latency_80 (default: all)",
    )
    together: bool = setting(
        False,
        "give both sides each gap at once: half the fights, and one side's loss is the other's gain",
    )
    episodes: int = setting(
        0, "fights of each pair; 0: those of the tournament, 5 of entrants", low=0, high=10**5
    )
    every: int = setting(
        0, "of a run every n-th chunk, and the last; 0: every one", low=0, high=10**6
    )
    name: str = setting("", "of entrants: folder in tournaments/ (default: the names of the runs)")
    seed: int = setting(0, "of entrants: seed of the start states", low=0, high=2**31 - 2)
    stochastic: bool = setting(
        False, "of entrants: draw the actions, as in training, instead of taking their mean"
    )
    mjcf: str = setting("", "the MJCF that was trained with, where no run says where it is")
    skip_bad: bool = setting(False, "leave out what cannot be read, and exit with 5")
    allow_env_mismatch: bool = setting(
        False, "let policies of another game fly in that of the first"
    )
    device: Literal["auto", "cpu", "gpu", "tpu"] = setting("auto", "where to compute")


def robustness(args: Sequence[str]) -> int:
    """how players fare on a drone that is not quite theirs"""
    words, rest = split_words(args, RobustnessFlags)
    prog = "dronecombat robustness"
    given: RobustnessFlags = flags.read(RobustnessFlags, rest, prog)
    if not words:
        raise UserError(f"nobody is named: {prog} TOURNAMENT, or {prog} ENTRANT [ENTRANT ...]")
    rate_on_one_core()
    prepare(given.device)
    from dronecombat_jax.report.figures import save_figure
    from dronecombat_jax.report.robustness_figure import robustness_figure
    from dronecombat_jax.tournaments import robustness as matrices

    planned = matrices.plan(
        words,
        name=given.name,
        episodes=given.episodes,
        every=given.every,
        seed=given.seed,
        stochastic=given.stochastic,
        mjcf=given.mjcf,
    )
    code, report = matrices.robustness(
        planned,
        gaps=given.gaps,
        together=given.together,
        skip_bad=given.skip_bad,
        allow_mismatch=given.allow_env_mismatch,
    )
    if report:
        folder = planned.path / matrices.FOLDER
        save_figure(robustness_figure(report), folder / "robustness.png")
        print(f"written to {folder}: {matrices.FILE}, robustness.md, robustness.png", flush=True)
    return code
