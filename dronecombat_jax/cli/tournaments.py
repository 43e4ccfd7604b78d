"""`dronecombat tournament`, `report` and `compare`."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from dronecombat_jax.cli.start import prepare, rate_on_one_core
from dronecombat_jax.cli.words import split_words
from dronecombat_jax.config import flags
from dronecombat_jax.config.setting import setting
from dronecombat_jax.config.starts import STARTS
from dronecombat_jax.errors import UserError


@dataclass(frozen=True)
class TournamentFlags:
    """Every attacker against every defender of the ENTRANTS before the flags, and how they rate.

    An entrant is a run (its folder, or its name in runs/), a policy file (.safetensors),
    scripted:NAME, scripted:all or pilots:NAME. Such as

        dronecombat tournament ippo sippo scripted:all --every 10
        dronecombat tournament pilots:all my_policy.safetensors --name mine
    """

    episodes: int = setting(
        5, "fights of each pair; fight e starts alike for all pairs", low=1, high=10**5
    )
    every: int = setting(1, "of a run every n-th chunk, and the last", low=1, high=10**6)
    untrained: bool = setting(
        False, "of a run also the players that it began with; the paper's are chunk ends alone"
    )
    name: str = setting("", "folder in tournaments/ (default: the names of the runs)")
    seed: int = setting(0, "seed of the start states", low=0, high=2**31 - 1)
    stochastic: bool = setting(
        False, "draw the actions, as in training, instead of taking their mean"
    )
    spawn: Literal["as_trained", "fixed", "uniform", "even"] = setting("as_trained", STARTS)
    flights: int = setting(
        0, "fights to record of each run's two sides of one chunk: how they fly", low=0, high=10**4
    )
    mjcf: str = setting("", "the MJCF that was trained with, where no run says where it is")
    skip_bad: bool = setting(False, "leave out what cannot be read, and exit with 5")
    allow_env_mismatch: bool = setting(
        False, "let policies of another game fly in that of the first"
    )
    device: Literal["auto", "cpu", "gpu", "tpu"] = setting("auto", "where to compute")


@dataclass(frozen=True)
class ReportFlags:
    """Draw a tournament: the paper's figures and more, tables, and one page that shows them all.

    A click on a cell of its win-rate map plays a fight of that pair. Such as

        dronecombat report ippo-sippo
        dronecombat report tournaments/mine --out report
    """

    tournament: str = setting(
        "", "the tournament: its folder, its name in tournaments/, or a result file"
    )
    out: str = setting("", "folder to write to (default: report/ in the tournament's folder)")


@dataclass(frozen=True)
class CompareFlags:
    """Does one method's final defender beat another's? All RUNS before the flags meet in one
    tournament.

    Every RUN is a folder, or a name in runs/. The scripted pilots take part as anchors. Flown is
    what the answer and its figures rest on: final defenders against everybody, each run against
    itself, scripted pilots against final ones. Such as

        dronecombat compare ippo sippo
        dronecombat compare runs/a runs/b runs/c --by selfplay.probability
    """

    by: str = setting(
        "method", "what parts the runs: method, preset, run, or a setting such as train.total_steps"
    )
    tournament: str = setting(
        "", "its folder in tournaments/ (default: compare- and the runs); alone: judge it again"
    )
    every: int = setting(
        10, "a run's attackers on the panel: every n-th chunk's, and the last", low=1, high=10**6
    )
    episodes: int = setting(50, "fights of each pair", low=1, high=10**5)
    seed: int = setting(0, "seed of the start states", low=0, high=2**31 - 1)
    spawn: Literal["as_trained", "fixed", "uniform", "even"] = setting("as_trained", STARTS)
    stochastic: bool = setting(
        False, "draw the actions, as in training, instead of taking their mean"
    )
    skip_bad: bool = setting(False, "leave out what cannot be read, and exit with 5")
    allow_env_mismatch: bool = setting(
        False, "let policies of another game fly in that of the first"
    )
    device: Literal["auto", "cpu", "gpu", "tpu"] = setting("auto", "where to compute")


def tournament(args: Sequence[str]) -> int:
    """every attacker against every defender, and how they rate"""
    prog = "dronecombat tournament"
    words, rest = split_words(args, TournamentFlags)
    given: TournamentFlags = flags.read(TournamentFlags, rest, prog)
    if not words:
        raise UserError(
            f"nobody is named: {prog} ENTRANT [ENTRANT ...], such as a run, scripted:all, policy.safetensors"
        )
    rate_on_one_core()
    prepare(given.device)
    from dronecombat_jax.arena.rectangle import Rules
    from dronecombat_jax.tournaments import tournament as tournaments

    rules = Rules(given.episodes, given.seed, given.stochastic)
    return tournaments.tournament(
        words,
        rules,
        name=given.name,
        every=given.every,
        untrained=given.untrained,
        flights=given.flights,
        spawn=given.spawn,
        mjcf=given.mjcf,
        skip_bad=given.skip_bad,
        allow_mismatch=given.allow_env_mismatch,
    )


def report(args: Sequence[str]) -> int:
    """draw a tournament: figures, tables and one page"""
    given: ReportFlags = flags.read(
        ReportFlags, args, "dronecombat report", positional="tournament"
    )
    rate_on_one_core()
    prepare("cpu")
    from dronecombat_jax.report import tournament_report
    from dronecombat_jax.watch.pairs import fights_page

    fights = partial(fights_page, say=lambda text: print(text, flush=True))
    out = Path(given.out) if given.out else None
    return tournament_report.report(given.tournament, out, fights)


def compare(args: Sequence[str]) -> int:
    """does one method's final defender beat another's?"""
    words, rest = split_words(args, CompareFlags)
    given: CompareFlags = flags.read(CompareFlags, rest, "dronecombat compare")
    rate_on_one_core()
    prepare(given.device)
    from dronecombat_jax.arena.rectangle import Rules
    from dronecombat_jax.tournaments import comparison

    return comparison.compare(
        words,
        Rules(given.episodes, given.seed, given.stochastic),
        by=given.by,
        name=given.tournament,
        every=given.every,
        spawn=given.spawn,
        skip_bad=given.skip_bad,
        allow_mismatch=given.allow_env_mismatch,
    )
