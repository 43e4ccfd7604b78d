"""Who flies against the learner in a view of one side.

    pilots_of(combat, ATTACKER, "scripted:hover_guard")           always the same
    pilots_of(combat, ATTACKER, ["pilots:sippo-defender", mine])  drawn anew for each fight

What does not live here: the fights (`one_side`), a tournament's field (`tournaments`).
"""

from collections.abc import Sequence
from typing import TypeAlias

import jax.numpy as jnp

from dronecombat_jax.adapters.one_side import refuse_wrong_number
from dronecombat_jax.arena.match import AnyPilot, Remembering, policy_team, scripted_team
from dronecombat_jax.arena.players import Player
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.fingerprint import environment, game_diff
from dronecombat_jax.combat.scripted import Pilot
from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.tournaments.contenders import Contender, find
from dronecombat_jax.tournaments.entrants import in_its_frame
from dronecombat_jax.types import SIDES

# A pilot, a word of the command line, several of both, or None where nobody is met.
Opponents: TypeAlias = Pilot | str | Sequence[Pilot | str] | None


def pilots_of(combat: Combat, role: int, opponents: Opponents) -> tuple[Pilot, ...]:
    """The pilots that the learner, as `role`, can meet; () where it is alone (`solo`). Of a team, one
    pilot flies all drones: a function of your own then gives [E, M, 4] for `E` fights.

    Words are those of a tournament: scripted:NAME, pilots:NAME, a policy file, a run (every chunk
    of it). Raises UserError for unknown words, for a pilot of the learner's own side, for one that
    was trained in another game, and where the scenario has no place for any, or needs one.
    """
    if opponents is None:
        given: Sequence[Pilot | str] = ()
    else:
        given = (opponents,) if callable(opponents) or isinstance(opponents, str) else opponents
    refuse_wrong_number(combat, role, len(given))
    pilots: list[Pilot] = []
    for opponent in given:
        pilots += _named(combat, 1 - role, opponent) if isinstance(opponent, str) else [opponent]
    return tuple(pilots)


def _named(combat: Combat, role: int, word: str) -> list[Pilot]:
    """The pilots of `role` that a word names."""
    flying = [
        in_its_frame(candidate, combat.config)
        for candidate in find(word).contenders
        if candidate.role == role and candidate.player is not None
    ]
    if not flying:
        raise UserError(f"{one_line(word)}: it names no {SIDES[role]}")
    for contender in flying:
        _refuse_other_game(combat, word, contender)
    return [
        _crew(combat, role, word, candidate.player)
        for candidate in flying
        if candidate.player is not None
    ]


def _refuse_other_game(combat: Combat, word: str, contender: Contender) -> None:
    if contender.environment is None:
        return
    lines = game_diff(contender.environment, environment(combat.config), combat.config.game)
    if lines:
        differences = "; ".join(one_line(line) for line in lines[:5])
        raise UserError(f"{one_line(word)} was trained in another game: {differences}", EXIT_DATA)


def _crew(combat: Combat, role: int, word: str, player: Player) -> Pilot:
    """The player at the controls of all drones of its side: a team's actions are [E, M, 4]."""
    if isinstance(player.pilot, str):
        team: Sequence[AnyPilot] = scripted_team(combat, player.pilot, role)
    else:
        learn = LearnConfig(normalize_observations=player.normalize)
        team = policy_team(combat.config, learn, player.pilot, role, False, player.observation)
    pilots = [pilot for pilot in team if not isinstance(pilot, Remembering)]
    if len(pilots) < len(team):
        raise UserError(
            f"{one_line(word)}: a policy with memory cannot be met in a view of one side: its fights keep nothing for it"
        )
    if len(pilots) == 1:
        return pilots[0]
    return lambda *given: jnp.stack([pilot(*given) for pilot in pilots], axis=1)
