"""The ladders that come with the package: how all shipped and scripted pilots stand, from one round
robin each.

    dronecombat_jax/pilots/ladder.json         from rest; both made by experiments/make_ladder.py
    dronecombat_jax/pilots/ladder_even.json    from even starts (`config.starts`)

What does not live here: rating a newcomer on it (`newcomers`), the fights (`tournament`).
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.analysis.bradley_terry import bradley_terry
from dronecombat_jax.analysis.newcomer import rate_newcomer
from dronecombat_jax.analysis.result import SCRIPTED, TournamentResult, fight_scores, scores
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.starts import AS_TRAINED
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.policies import shipped
from dronecombat_jax.tournaments.contenders import SCRIPTED_PREFIX
from dronecombat_jax.types import SIDES

LADDERS = {AS_TRAINED: "ladder.json", "even": "ladder_even.json"}  # by the starts
FORMAT = 1
WORST = 3


class Rung(NamedTuple):
    """One player of the ladder."""

    name: str
    also: tuple[str, ...]  # shipped pilots of the same content
    role: str  # of `SIDES`
    scripted: bool
    identity: str  # as of `arena.players.Player`
    rating: float  # Bradley-Terry, Elo points; the mean over all rungs of both sides is 1500
    low: float  # of its 95 % interval
    high: float
    score: float  # mean over its fights: a win 1, a tie 1/2
    worst: tuple[tuple[str, float], ...]  # those who beat it, the worst first, and its score

    @property
    def word(self) -> str:
        """The player's name on a command line."""
        return f"{SCRIPTED_PREFIX if self.scripted else shipped.PREFIX}{self.name}"


class Ladder(NamedTuple):
    """The standing, and the game and the starts that it was flown with."""

    preset: str
    environment_sha256: str  # of that preset's game
    episodes: int  # fights of each pair
    seed: int  # of the start states
    rungs: tuple[Rung, ...]  # defenders, then attackers, the best first
    spawn: str = AS_TRAINED  # where its fights start, of `LADDERS`

    def side(self, role: str) -> list[Rung]:
        """The rungs of one role, the best first."""
        return [rung for rung in self.rungs if rung.role == role]


def standing(result: TournamentResult, also: Mapping[str, Sequence[str]]) -> tuple[Rung, ...]:
    """The rungs of a complete round robin; `also`: further names by identity.

    Ratings are those of all fights together; a rung's interval is what it would get as a newcomer
    to the others.
    """
    wins, ties, losses = scores(result)
    ratings, points = bradley_terry(wins, losses, ties).rating, fight_scores(result)
    sides = result.defenders, result.attackers
    anchors = ratings[len(sides[0]) :], ratings[: len(sides[0])]
    rungs: list[Rung] = []
    for role, name in enumerate(SIDES):
        others = [entrant.label for entrant in sides[1 - role]]
        side = []
        for index, entrant in enumerate(sides[role]):
            player = index + role * len(sides[0])
            own = 1.0 - points[:, index] if role else points[index]  # [N, E]
            placing = rate_newcomer(own, anchors[role])
            rung = Rung(
                name=entrant.label,
                also=tuple(also.get(entrant.identity, ())),
                role=name,
                scripted=entrant.method == SCRIPTED,
                identity=entrant.identity,
                rating=float(ratings[player]),
                low=placing.low,
                high=placing.high,
                score=float(own.mean()),
                worst=worst_of(own.mean(axis=1), others),
            )
            side.append(rung)
        rungs += sorted(side, key=lambda rung: -rung.rating)
    return tuple(rungs)


def worst_of(score: NDArray[Any], others: Sequence[str]) -> tuple[tuple[str, float], ...]:
    """The opponents against whom a player scores least, of those who beat it; `score` [N]."""
    order = np.argsort(score, kind="stable")[:WORST]
    return tuple((others[int(i)], float(score[i])) for i in order if score[i] < 0.5)


def ladder_text(ladder: Ladder) -> str:
    """The file's content; ratings to a hundredth of a point."""
    rungs = [
        rung._asdict()
        | {part: round(getattr(rung, part), 2) for part in ("rating", "low", "high")}
        | {"score": round(rung.score, 4)}
        | {"worst": [[name, round(share, 4)] for name, share in rung.worst]}
        for rung in ladder.rungs
    ]
    return json.dumps({"format": FORMAT, **ladder._asdict(), "rungs": rungs}, indent=1) + "\n"


def read_ladder(spawn: str = AS_TRAINED) -> Ladder:
    """The ladder of this package whose fights start so, of `LADDERS`. UserError 2 for other
    starts, 3 where it holds none, or one that cannot be read.
    """
    if spawn not in LADDERS:
        raise UserError(f"--spawn {one_line(spawn)}: expected one of {', '.join(LADDERS)}")
    path = shipped.FOLDER / LADDERS[spawn]
    try:
        table = json.loads(path.read_text())
        if (version := table.pop("format")) > FORMAT:
            raise UserError(f"{path} has format {version}: upgrade dronecombat-jax", EXIT_DATA)
        rungs = tuple(
            Rung(**{**rung, "also": tuple(rung["also"]), "worst": tuple(map(tuple, rung["worst"]))})
            for rung in table.pop("rungs")
        )
        return Ladder(**table, rungs=rungs)
    except FileNotFoundError:
        raise UserError(f"this package holds no ladder: {path} is missing", EXIT_DATA) from None
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise UserError(
            f"{path}: damaged or no ladder: {one_line(str(error))}", EXIT_DATA
        ) from None
