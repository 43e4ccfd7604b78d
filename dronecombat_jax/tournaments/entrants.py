"""The field of a tournament: who was named, verified whole before anything is compiled, each player
once.

What does not live here: reading one run or file (`contenders`).
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from dronecombat_jax.analysis.result import Alias, Entrant
from dronecombat_jax.arena.players import Player, refuse_other_shape
from dronecombat_jax.combat.fingerprint import (
    ROTORS,
    SCENE,
    environment,
    environment_diff,
    game_diff,
    own_view,
)
from dronecombat_jax.combat.games import game_of
from dronecombat_jax.config import settings
from dronecombat_jax.config.body_file import is_file
from dronecombat_jax.config.fields import Config, SimConfig
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.starts import AS_TRAINED, with_starts
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA, UserError
from dronecombat_jax.tournaments.contenders import EXPORTED, Contender, Found, find
from dronecombat_jax.types import ATTACKER, DEFENDER, SIDES

ANCHOR_PRESET = "duel"  # the game of scripted pilots alone
_MAX_NAMED = 5


class Seat(NamedTuple):
    """One row or column of the grid."""

    entrant: Entrant
    player: Player | None  # None: missing, its cells stay empty
    # labels of others with the same content, files among them, which are not flown again
    also: tuple[str, ...]


class Field(NamedTuple):
    """All players of a tournament, by role."""

    config: Config  # of the game that is played
    seats: tuple[list[Seat], list[Seat]]
    notices: tuple[str, ...]  # for a person, one line each
    bad: tuple[str, ...]  # what could not be read


def read_field(
    words: Sequence[str],
    *,
    every: int = 1,
    untrained: bool = False,
    skip_bad: bool = False,
    allow_mismatch: bool = False,
    mjcf: str = "",
    spawn: str = AS_TRAINED,
) -> Field:
    """Read and check everybody whom `words` name (`contenders.find`).

    `mjcf`: the file of the drone or scene to fly, instead of where their runs left it; `spawn`:
    where fights start, whatever the policies have met (`config.starts`).
    Raises UserError: 2 for words that mean nothing and for a side without players; 3 that lists
    every checkpoint or file that cannot be used (unless `skip_bad`), or every player of another
    game (unless `allow_mismatch`).
    """
    sources, bad = _find_all(words, every, untrained)
    if bad and not skip_bad:
        raise UserError(
            "\n".join([*bad, "nothing was flown; --skip-bad flies the others"]), EXIT_DATA
        )
    config = _game(sources, mjcf)
    contenders = [
        in_its_frame(contender, config) for source in sources for contender in source.contenders
    ]
    if not all(game_of(config).flies):
        raise UserError(
            f"these policies were trained in {config.game.scenario}, where nobody defends: there is no fight",
            EXIT_CONFIG,
        )
    notices = _other_games(contenders, config, allow_mismatch)
    for contender in contenders:
        if contender.player is not None:
            label, player = contender.entrant.label, contender.player
            refuse_other_shape(label, contender.role, player.pilot, config, player.observation)
    _refuse_two_of_a_name(contenders)
    seats = _seats(contenders, DEFENDER), _seats(contenders, ATTACKER)
    for role, side in enumerate(seats):
        if not any(seat.player for seat in side):
            raise UserError(
                f"no {SIDES[role]} takes part; name a run, a policy file or a scripted pilot",
                EXIT_CONFIG,
            )
        notices += _saved_again(role, side)
    if with_starts(config, spawn) != config:
        notices += [f"fights start at other places than in training: {spawn}"]
    return Field(with_starts(config, spawn), seats, tuple(notices), tuple(bad))


def in_its_frame(contender: Contender, config: Config) -> Contender:
    """The contender with the name of what it sees, where that is not what the game shows."""
    if contender.player is None:
        return contender
    seen = own_view(contender.environment, config.game)
    return contender._replace(player=contender.player._replace(observation=seen))


def _game(sources: list[Found], mjcf: str) -> Config:
    """The game of the first player whose scene file is here, else of the first player.

    A policy file of an own drone says what its MJCF says, not where it is: a run does.
    """
    first: Config | None = None
    for entry in sources:
        if entry.config is None:
            continue
        sim = entry.config.sim
        config = replace(entry.config, sim=_with_drone(sim, mjcf))
        first = first or config
        known = [contender.environment for contender in entry.contenders if contender.environment]
        lines = environment_diff(known[-1], environment(config)) if known else []
        if not any(line.startswith((SCENE, ROTORS)) for line in lines):
            return config
    anchor = settings.load(ANCHOR_PRESET)
    return first or replace(anchor, sim=_with_drone(anchor.sim, mjcf))


def _with_drone(sim: SimConfig, file: str) -> SimConfig:
    """The same with the drone of `file`, an MJCF or a TOML; as it is for ""."""
    if is_file(file):
        body: Any = file
        return replace(sim, body=body)
    return replace(sim, mjcf=file or sim.mjcf)


def _find_all(words: Sequence[str], every: int, untrained: bool) -> tuple[list[Found], list[str]]:
    """Who was found, and one line for each thing that cannot be used."""
    sources: list[Found] = []
    bad: list[str] = []
    meaningless: list[str] = []
    for word in dict.fromkeys(words):
        try:
            sources.append(find(word, every, untrained))
        except UserError as error:
            (bad if error.exit_code == EXIT_DATA else meaningless).extend(
                error.message.splitlines()
            )
    if meaningless:
        raise UserError("\n".join(meaningless), EXIT_CONFIG)
    return sources, bad + [line for source in sources for line in source.bad]


def _other_games(contenders: list[Contender], config: Config, allowed: bool) -> list[str]:
    """One line for each group of players who know another game than that of `config`; UserError 3
    unless `allowed`.
    """
    here, groups = environment(config), {}
    for contender in contenders:
        if contender.environment is not None:
            lines = tuple(game_diff(contender.environment, here, config.game))
            groups.setdefault(lines, []).append(contender.entrant.label)
    faults = [
        f"{_named(tuple(dict.fromkeys(labels)))} trained in another game than the first: {one_line(_named(lines, '; '))}"
        for lines, labels in groups.items()
        if lines
    ]
    if faults and not allowed:
        own = any(line.startswith((SCENE, ROTORS)) for lines in groups for line in lines)
        hint = (
            "dronecombat tournament --mjcf FILE names the MJCF or TOML that they were trained with"
        )
        allowing = "--allow-env-mismatch lets them fly in the first one's game"
        raise UserError("\n".join([*faults, *([hint] if own else []), allowing]), EXIT_DATA)
    return faults


def _refuse_two_of_a_name(contenders: list[Contender]) -> None:
    """Raise UserError 2 where two runs are called the same: their players could not be told apart."""
    known: dict[tuple[int, str], str] = {}
    for role, entrant, _, _ in contenders:
        if (
            entrant.method != EXPORTED
            and known.setdefault((role, entrant.label), entrant.identity) != entrant.identity
        ):
            raise UserError(
                f"two different players are called {entrant.label}: rename one of the runs",
                EXIT_CONFIG,
            )


def _saved_again(role: int, side: list[Seat]) -> list[str]:
    """Lines for the user about players of the same content."""
    lines = [
        f"{SIDES[role]} {seat.entrant.label} is also {_named(seat.also)}"
        for seat in side
        if seat.also
    ]
    if len(lines) > _MAX_NAMED:
        return [
            f"{len(lines)} {SIDES[role]}s were saved more than once (such as {lines[0]}): flown once each"
        ]
    return [f"{line}: flown once" for line in lines]


def _seats(contenders: list[Contender], role: int) -> list[Seat]:
    """The players of one side in the order named, each content once, under the name of a run rather
    than of a file.
    """
    named: dict[str, dict[str, Contender]] = {}
    for contender in contenders:
        if contender.role == role:
            named.setdefault(contender.entrant.identity, {}).setdefault(
                contender.entrant.label, contender
            )
    return [_seat(list(same.values())) for same in named.values()]


def _seat(same: list[Contender]) -> Seat:
    """One place for contenders of the same content."""
    # else in the order named
    first, *others = sorted(same, key=lambda contender: contender.entrant.method == EXPORTED)
    saved = [other.entrant for other in others if other.entrant.method != EXPORTED]
    also = tuple(
        Alias(
            contender.label,
            contender.method,
            contender.run,
            contender.seed,
            contender.chunk,
            contender.steps,
        )
        for contender in saved
    )
    return Seat(
        first.entrant._replace(also=also),
        first.player,
        tuple(other.entrant.label for other in others),
    )


def _named(texts: Sequence[str], separator: str = ", ") -> str:
    more = f" and {len(texts) - _MAX_NAMED} more" if len(texts) > _MAX_NAMED else ""
    return separator.join(texts[:_MAX_NAMED]) + more
