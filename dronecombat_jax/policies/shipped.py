"""The pilots that come with the package: policy files by name, each with a card.

    dronecombat_jax/pilots/METHOD-SIDE-CHUNK.safetensors    such as ippo-attacker-34
    dronecombat_jax/pilots/cards.json                       how each was trained, and how it rates
    dronecombat_jax/pilots/ladder.json                      the standing (`tournaments.ladder`)

`pilots:METHOD-SIDE` is the newest of its kind. Made by `experiments/make_pilots.py`. What does not
live here: reading a policy file (`file`).
"""

import json
import re
from pathlib import Path
from typing import NamedTuple

from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.settings import suggestion
from dronecombat_jax.errors import EXIT_DATA, UserError

PREFIX = "pilots:"
ALL = "all"
FOLDER = Path(__file__).resolve().parents[1] / "pilots"
CARDS = "cards.json"
_NAME = re.compile(r"([a-z]+)-(defender|attacker)-(\d+)")


class Card(NamedTuple):
    """What is known of one shipped pilot."""

    trained: str  # the command
    steps: int  # environment steps of its training
    rating: float  # Bradley-Terry, Elo points; the mean of all shipped and scripted pilots is 1500
    low: float  # of its 95 % interval
    high: float
    loses_to: tuple[str, ...]  # its worst opponents, the worst first, with its score against each


def names() -> list[str]:
    """Names of all shipped pilots, in order of method, side and chunk."""
    matches = [
        match for path in FOLDER.glob("*.safetensors") if (match := _NAME.fullmatch(path.stem))
    ]
    return [
        match[0]
        for match in sorted(matches, key=lambda match: (*match.groups()[:2], int(match[3])))
    ]


def paths(name: str) -> list[Path]:
    """Files of the pilots that `name` means: `all`, METHOD-SIDE-CHUNK, or METHOD-SIDE, the newest.

    Raises UserError 2 for an unknown name, 3 where the package was installed without pilots.
    """
    known = names()
    if not known:
        raise UserError(f"{PREFIX}{one_line(name)}: this package holds no pilots", EXIT_DATA)
    newest = {pilot.rpartition("-")[0]: pilot for pilot in known}  # in order of chunks
    if name == ALL:
        chosen = known
    elif name in known or name in newest:
        chosen = [newest.get(name, name)]
    else:
        meant = suggestion(name, [*newest, *known])
        raise UserError(f"{PREFIX}{one_line(name)}: no pilot has this name; {meant}")
    return [FOLDER / f"{pilot}.safetensors" for pilot in chosen]


def cards() -> dict[str, Card]:
    """The card of each pilot by name."""
    table = json.loads((FOLDER / CARDS).read_text())
    return {
        name: Card(**{**card, "loses_to": tuple(card["loses_to"])}) for name, card in table.items()
    }
