"""`dronecombat replay`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from dronecombat_jax.cli.start import prepare
from dronecombat_jax.cli.words import split_words
from dronecombat_jax.config import flags
from dronecombat_jax.config.setting import setting
from dronecombat_jax.config.starts import STARTS


@dataclass(frozen=True)
class ReplayFlags:
    """Fly fights and write one page that replays them in a browser: no server, no network, no other
    file.

    Before the flags: a RUN (its folder, or its name in runs/), policy files (.safetensors),
    scripted:NAME or pilots:NAME (`dronecombat pilots` lists them). Without any the last run, or
    where there is none yet pilots that come with the package. Such as

        dronecombat replay
        dronecombat replay ippo --defender hover_guard --attacker 12
        dronecombat replay ippo --evolution
        dronecombat replay --defender hover --attacker dash --out fight.gif
    """

    defender: str = setting(
        "", "who defends: a chunk of RUN, a scripted pilot, a policy file, another run or RUN:CHUNK"
    )
    attacker: str = setting(
        "", "who attacks, likewise; without it the newest of RUN, or the file's"
    )
    fights: int = setting(
        9, "how many fights, side by side; a film shows the first", low=1, high=16
    )
    seed: int = setting(
        0, "seed of the start states; fight e starts as in a tournament", low=0, high=2**31 - 1
    )
    evolution: bool = setting(
        False, "one start, flown by the policies of 0 %, 10 %, ... 100 % of RUN's training"
    )
    out: str = setting(
        "", "the file: .html, or a film .mp4, .gif, .webp (default: replay.html in RUN's folder)"
    )
    open: bool = setting(False, "open the page in a browser, where there is one")
    run_seed: int = setting(-1, "which of the run's seeds; -1: its first", low=-1, high=2**31 - 1)
    stochastic: bool = setting(
        False, "draw the actions, as in training, instead of taking their mean"
    )
    spawn: Literal["auto", "as_trained", "fixed", "uniform", "even"] = setting(
        "auto", f"{STARTS}; auto: even where no pilot is named, else as trained"
    )
    allow_env_mismatch: bool = setting(
        False, "let policies of another game fly in that of the first"
    )
    device: Literal["auto", "cpu", "gpu", "tpu"] = setting("auto", "where to compute")


def replay(args: Sequence[str]) -> int:
    """fights on one page that any browser plays, or as a film"""
    words, rest = split_words(args, ReplayFlags)
    given: ReplayFlags = flags.read(ReplayFlags, rest, "dronecombat replay")
    prepare(given.device)
    from dronecombat_jax.watch import replay as room
    from dronecombat_jax.watch.flyers import Named
    from dronecombat_jax.watch.recording import Filming

    spawn = "" if given.spawn == "auto" else given.spawn
    return room.replay(
        Named(
            tuple(words), (given.defender, given.attacker), given.run_seed, given.allow_env_mismatch
        ),
        Filming(given.fights, given.seed, given.stochastic, spawn),
        out=Path(given.out) if given.out else None,
        evolution=given.evolution,
        browser=given.open,
    )
