"""`dronecombat rate`: a policy meets the ladder's players of the other side, from the ladder's starts.

There is one ladder from rest and one from even starts. A policy is shown the layout of observations
that its own file names. What does not live here: the ladder (`ladder`), the statistics
(`analysis.newcomer`).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dronecombat_jax.analysis.newcomer import rate_newcomer
from dronecombat_jax.analysis.result import score_of
from dronecombat_jax.arena.players import Player, refuse_other_shape
from dronecombat_jax.arena.rectangle import Rules
from dronecombat_jax.arena.round_robin import play
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.fingerprint import digest_of, environment, game_diff
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.starts import AS_TRAINED, with_starts
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.runs.progress import make_progress
from dronecombat_jax.tournaments.contenders import Contender, find
from dronecombat_jax.tournaments.entrants import in_its_frame
from dronecombat_jax.tournaments.flying import progress_of
from dronecombat_jax.tournaments.ladder import Ladder, read_ladder, worst_of
from dronecombat_jax.types import SIDES, Cause

NEWEST = 10**9  # of a run no chunk but the last
_MAX_NAMED = 5


class Rated(NamedTuple):
    """How a newcomer stands on the ladder."""

    name: str
    role: str  # of `SIDES`
    rating: float  # Elo points, in the ladder's gauge
    low: float  # of the 95 % interval; -inf where it never scored
    high: float  # inf where it was never beaten
    place: int  # among the players of its role on the ladder, 1 the best; itself counted once
    places: int
    score: float  # mean over its fights: a win 1, a tie 1/2
    fights: int
    worst: tuple[tuple[str, float], ...]  # those who beat it, the worst first, and its score
    notes: tuple[str, ...]  # what a reader should know, one line each


def rate(
    word: str,
    *,
    role: str = "",
    fights: int = 0,
    allow_mismatch: bool = False,
    spawn: str = AS_TRAINED,
) -> list[Rated]:
    """Rate whom `word` names: a policy file, `pilots:NAME`, `scripted:NAME`, or a run's newest.

    `role`: whose policies; "": all that there are. `fights` against each opponent; 0: as many as
    the ladder's own; `spawn`: where they start, which says on which ladder (`ladder.LADDERS`).
    Raises UserError: 2 for a word or a role that names nobody, 3 for what cannot
    be read and for policies of another game (unless `allow_mismatch`).
    """
    ladder = read_ladder(spawn)
    contenders = _contenders(word, role)
    config = settings.load(ladder.preset)
    combat = Combat(with_starts(config, ladder.spawn))
    here = environment(config, combat.scene)
    if digest_of(here) != ladder.environment_sha256:
        raise UserError(
            f"the ladder was flown in another game than this version's preset {ladder.preset}: "
            "python experiments/make_ladder.py makes it anew",
            EXIT_DATA,
        )
    contenders = [in_its_frame(contender, config) for contender in contenders]
    notes = [
        _differences(contender, here, config, ladder, allow_mismatch) for contender in contenders
    ]
    rules = Rules(fights or ladder.episodes, ladder.seed)
    rated: dict[int, Rated] = {}
    for number, side in enumerate(SIDES):
        mine = [index for index, contender in enumerate(contenders) if contender.role == number]
        if mine:
            some = [contenders[index] for index in mine]
            known = [notes[index] for index in mine]
            rated |= zip(mine, _rate_side(combat, ladder, side, some, known, rules), strict=True)
    return [rated[index] for index in range(len(contenders))]


def rated_text(rated: Rated) -> str:
    """What `dronecombat rate` prints of a newcomer."""
    low = "never scored" if math.isinf(rated.low) else f"{rated.low:.1f}"
    high = "never beaten" if math.isinf(rated.high) else f"{rated.high:.1f}"
    worst = ", ".join(f"{name} ({share:.2f})" for name, share in rated.worst) or "nobody"
    return "\n".join(
        [
            f"{rated.role} {rated.name}: rating {rated.rating:.1f}, 95 % [{low}, {high}], "
            f"place {rated.place} of {rated.places}",
            f"  score {rated.score:.3f} in {rated.fights:,} fights; loses to: {worst}",
            *(f"  note: {note}" for note in rated.notes),
        ]
    )


def _contenders(word: str, role: str) -> list[Contender]:
    """Whom `word` names, of `role` alone where it is given."""
    named = find(word, every=NEWEST)
    if named.bad:
        raise UserError("\n".join(named.bad), EXIT_DATA)
    chosen = [contender for contender in named.contenders if role in ("", SIDES[contender.role])]
    if not chosen:
        other = SIDES[1 - SIDES.index(role)]
        raise UserError(f"{one_line(word)} flies as {other} alone, not as {role}")
    return chosen


def _differences(
    contender: Contender, here: dict, config: Config, ladder: Ladder, allowed: bool
) -> tuple[str, ...]:
    """What a reader should know of the game that a policy was trained in; UserError 3 unless
    `allowed`.
    """
    if contender.environment is None:
        return ()
    differ = [one_line(line) for line in game_diff(contender.environment, here, config.game)]
    if not differ:
        return ()
    more = f"; and {len(differ) - _MAX_NAMED} more" if len(differ) > _MAX_NAMED else ""
    text = (
        f"trained in another game than the ladder's, preset {ladder.preset}: "
        f"{'; '.join(differ[:_MAX_NAMED])}{more}"
    )
    if not allowed:
        raise UserError(
            f"{contender.entrant.label} was {text}; --allow-env-mismatch rates it all the same",
            EXIT_DATA,
        )
    return (text,)


def _rate_side(
    combat: Combat,
    ladder: Ladder,
    side: str,
    contenders: Sequence[Contender],
    notes: Sequence[tuple[str, ...]],
    rules: Rules,
) -> list[Rated]:
    """Rate newcomers who all fly as `side`."""
    players = [contender.player for contender in contenders if contender.player is not None]
    for contender, player in zip(contenders, players, strict=True):
        label = contender.entrant.label
        refuse_other_shape(
            label, SIDES.index(side), player.pilot, combat.config, player.observation
        )
    rungs = ladder.side(SIDES[1 - SIDES.index(side)])
    opponents = [player for rung in rungs for player in _players(rung.word, combat.config)]
    score = _fly(combat, side, players, opponents, rules)
    rivals = ladder.side(side)
    anchors = np.asarray([rung.rating for rung in rungs])
    rated = []
    for contender, player, points, lines in zip(contenders, players, score, notes, strict=True):
        placing = rate_newcomer(points, anchors)
        others = [rung for rung in rivals if rung.identity != player.identity]
        rated.append(
            Rated(
                contender.entrant.label,
                side,
                *placing,
                place=1 + sum(rung.rating > placing.rating for rung in others),
                places=1 + len(others),
                score=float(points.mean()),
                fights=points.size,
                worst=worst_of(points.mean(axis=1), [rung.name for rung in rungs]),
                notes=lines,
            )
        )
    return rated


def _fly(
    combat: Combat,
    side: str,
    players: Sequence[Player],
    opponents: Sequence[Player],
    rules: Rules,
) -> np.ndarray:
    """Scores [players, opponents, E] of the newcomers: 1, 1/2 or 0."""
    defends = side == SIDES[0]
    sides = (players, opponents) if defends else (opponents, players)
    points = score_of(outcome_table(combat.config.game))
    score = np.full((len(sides[0]), len(sides[1]), rules.episodes), np.nan)
    with make_progress(f"{side}s", score.size, unit="fights") as progress:
        flown = np.zeros(len(Cause), int)
        for harvest in play(combat, *sides, rules, compiling=progress.compiling):
            for cell in harvest.cells:
                score[cell.defender, cell.attacker] = points[cell.cause]
            flown += harvest.fights
            progress.update(progress_of(combat.config.game, 0, flown))
    return score if defends else 1.0 - np.moveaxis(score, 0, 1)


def _players(word: str, config: Config) -> list[Player]:
    flying = (in_its_frame(contender, config).player for contender in find(word).contenders)
    return [player for player in flying if player is not None]
