"""`dronecombat play`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from dronecombat_jax.cli.start import prepare
from dronecombat_jax.cli.words import split_words
from dronecombat_jax.config import flags
from dronecombat_jax.config.setting import setting


@dataclass(frozen=True)
class PlayFlags:
    """Write one page on which you fly against a policy, with keyboard, mouse, gamepad or fingers: no
    server, no network, no other file.

    Before the flags, the opponent: a RUN (its folder, or its name in runs/), RUN:CHUNK, a policy
    file (.safetensors), scripted:NAME or pilots:NAME; without any the last run, or where there is
    none yet a defender that comes with the package. Such as

        dronecombat play ippo
        dronecombat play ippo:12 --side defender
        dronecombat play scripted:dash --open
    """

    side: Literal["opposite", "attacker", "defender"] = setting(
        "opposite",
        "what you fly; opposite: the side that the opponent does not fly (of a RUN: the attacker)",
    )
    out: str = setting("", "the file, .html (default: play.html in RUN's folder)")
    open: bool = setting(False, "open the page in a browser, where there is one")
    run_seed: int = setting(-1, "which of the run's seeds; -1: its first", low=-1, high=2**31 - 1)


def play(args: Sequence[str]) -> int:
    """a page on which you fly against a policy yourself"""
    words, rest = split_words(args, PlayFlags)
    given: PlayFlags = flags.read(PlayFlags, rest, "dronecombat play")
    prepare("cpu")
    from dronecombat_jax.watch import play as room

    return room.play(
        tuple(words),
        side="" if given.side == "opposite" else given.side,
        run_seed=given.run_seed,
        out=Path(given.out) if given.out else None,
        browser=given.open,
    )
