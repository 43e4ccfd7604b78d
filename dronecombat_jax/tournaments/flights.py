"""How the players of a tournament fly: each run's two sides of one chunk against each other,
recorded step by step.

    tournaments/<name>/flights.json    one row for each run and chunk of which both sides take part

What does not live here: the quantities themselves (`analysis.behaviour`).
"""

import json
import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.analysis.behaviour import Flight, flight
from dronecombat_jax.analysis.result import Entrant, by_training
from dronecombat_jax.arena.lanes import start_states
from dronecombat_jax.arena.match import policy_team, record
from dronecombat_jax.arena.players import Player
from dronecombat_jax.arena.rectangle import Rules
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.files.atomic import write_atomic
from dronecombat_jax.learn.mates import Both
from dronecombat_jax.types import ATTACKER, DEFENDER, FightRecord

FLIGHTS_NAME = "flights.json"


class Flown(NamedTuple):
    """Means over a pair's recorded fights; NaN where nothing was measured. Pairs of numbers:
    defender, attacker, of teams as `analysis.behaviour.Flight` says.
    """

    run: str  # `Entrant.lineage`
    method: str
    chunk: int
    steps: int  # environment steps trained
    fights: int
    time: float  # s, to the end
    closing_speed: float  # m/s, at the end
    approach_angle: float  # rad, of the velocities at the end: 0 a tail chase, pi head on
    altitude: tuple[float, float]  # m
    lowest: tuple[float, float]  # m
    path_ratio: tuple[float, float]  # length flown over distance between its ends
    control_effort: tuple[float, float]  # mean of |u|^2


def record_flights(
    combat: Combat,
    entrants: tuple[Sequence[Entrant], Sequence[Entrant]],
    players: tuple[Sequence[Player | None], Sequence[Player | None]],
    rules: Rules,
    fights: int,
) -> list[Flown]:
    """Record `fights` fights of every pair, from the start states of the tournament's first ones."""
    starts = start_states(combat, rules.seed, fights)
    key = jax.random.key(rules.seed)

    @partial(jax.jit, static_argnums=0)
    def fly(views: tuple[tuple[bool, str], ...], both: Both) -> FightRecord:
        teams = [
            policy_team(
                combat.config,
                LearnConfig(normalize_observations=scaled),
                both[role],
                role,
                rules.stochastic,
                observation,
            )
            for role, (scaled, observation) in enumerate(views)
        ]
        return record(combat, teams[DEFENDER], teams[ATTACKER], starts, key)

    known: dict[tuple[int, int], Flight] = {}
    flown = []
    for entrant, pair in _pairs(entrants):
        defender, attacker = players[DEFENDER][pair[0]], players[ATTACKER][pair[1]]
        if (
            not (defender and attacker)
            or isinstance(defender.pilot, str)
            or isinstance(attacker.pilot, str)
        ):
            continue
        if pair not in known:  # a policy that a chunk did not change flies as before
            views = tuple((player.normalize, player.observation) for player in (defender, attacker))
            flights = fly(views, (defender.pilot, attacker.pilot))
            known[pair] = flight(
                jax.device_get(flights), combat.config.control_dt, combat.config.game.sides
            )
        flown.append(_summary(entrant, known[pair]))
    return flown


def save_flights(folder: Path, flown: Sequence[Flown]) -> None:
    """Write `flights.json`. UserError 73."""
    plain = lambda value: None if isinstance(value, float) and not math.isfinite(value) else value
    spelt = lambda value: (
        [plain(item) for item in value] if isinstance(value, tuple) else plain(value)
    )
    rows = [{name: spelt(value) for name, value in item._asdict().items()} for item in flown]
    write_atomic(folder / FLIGHTS_NAME, json.dumps(rows, indent=1, allow_nan=False) + "\n")


def load_flights(folder: Path) -> tuple[Flown, ...]:
    """The rows in a tournament's folder, none where no fights were recorded.

    UserError 3 where they are damaged.
    """
    path = folder / FLIGHTS_NAME
    if not path.is_file():
        return ()
    number = lambda value: math.nan if value is None else value
    read: Any = lambda value: (
        tuple(map(number, value)) if isinstance(value, list) else number(value)
    )
    try:
        return tuple(
            Flown(**{name: read(value) for name, value in row.items()})
            for row in json.loads(path.read_text())
        )
    except (OSError, ValueError, TypeError, AttributeError, RecursionError) as error:
        raise UserError(
            f"{one_line(str(path))}: damaged: {one_line(str(error))}", EXIT_DATA
        ) from None


def _pairs(
    entrants: tuple[Sequence[Entrant], Sequence[Entrant]],
) -> list[tuple[Entrant, tuple[int, int]]]:
    """For every run and chunk with both sides: the name of its defender, and the indices of both
    players.
    """
    defenders, attackers = (by_training(side) for side in entrants)
    pairs = []
    for lineage, saved in defenders.items():
        met = {entrant.chunk: index for index, entrant in attackers.get(lineage, ())}
        pairs += [
            (entrant, (index, met[entrant.chunk]))
            for index, entrant in saved
            if entrant.chunk in met
        ]
    return pairs


def _summary(entrant: Entrant, flight: Flight) -> Flown:
    both: Any = lambda values: (_mean(values[:, DEFENDER]), _mean(values[:, ATTACKER]))
    return Flown(
        run=entrant.lineage,
        method=entrant.method,
        chunk=entrant.chunk,
        steps=entrant.steps,
        fights=len(flight.time),
        time=_mean(flight.time),
        closing_speed=_mean(flight.closing_speed),
        approach_angle=_mean(flight.approach_angle),
        altitude=both(flight.altitude),
        lowest=both(flight.lowest),
        path_ratio=both(flight.path_ratio),
        control_effort=both(flight.control_effort),
    )


def _mean(values: NDArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan
