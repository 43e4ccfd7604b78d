"""Everything that a tournament's report shows, computed once from its result; no drawing, no files.

The paper's figures 4 to 9 rate every run in its own tournament, its defenders against its
attackers, and average over seeds. All other ratings are of the whole tournament. What is missing is
said in words and never made up.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.analysis.alpha_rank import alpha_rank
from dronecombat_jax.analysis.behaviour import Endings, endings
from dronecombat_jax.analysis.bradley_terry import Ratings, bradley_terry, davidson
from dronecombat_jax.analysis.cyclic import CyclicShare, cyclic_share
from dronecombat_jax.analysis.design import complete_part
from dronecombat_jax.analysis.elo import EloRatings, elo_ratings
from dronecombat_jax.analysis.forgetting import (
    Forgetting,
    RunMap,
    forgetting,
    home_and_away,
    run_maps,
)
from dronecombat_jax.analysis.gaps import missing
from dronecombat_jax.analysis.nash import (
    NashAverage,
    PopulationValue,
    nash_average,
    population_values,
)
from dronecombat_jax.analysis.random_walk import Curve, random_walk_curve, timelines
from dronecombat_jax.analysis.result import (
    Entrant,
    TournamentResult,
    by_training,
    first_episodes,
    score_rate,
    scores,
    select,
    showings,
    win_rate,
)
from dronecombat_jax.types import ATTACKER, DEFENDER, SIDES

ELO_EPISODES = 5  # a cell, as in the paper's ratings; its maps take all
LARGEST_CURVE = 1000  # players: above, the smoothed curve would take minutes
LARGEST_ALPHA_RANK = 2e7  # numbers in its tables
ALL = "all entrants"


class Effort(NamedTuple):
    """How many random samples a study takes."""

    orders: int = 32  # of the fights, for Elo
    bootstrap: int = 400  # for the cyclic share
    value_samples: int = 100  # for the population values


class Memory(NamedTuple):
    """How one run's final policies fare against the past."""

    defender: Forgetting
    attacker: Forgetting
    home: float  # the final defender's mean score against its own run's attackers
    away: float  # against other runs' attackers


class Scale(NamedTuple):
    """Ratings [P] in points; NaN for players without fights."""

    rating: NDArray[np.float64]
    low: NDArray[np.float64]  # infinite where nothing bounds the rating
    high: NDArray[np.float64]


class Study(NamedTuple):
    """The numbers of a report. Players are numbered defenders first, then attackers: P = D + A."""

    result: TournamentResult
    methods: tuple[str, ...]  # of trained entrants, in order of appearance
    # by lineage: Elo [P] within the run's own tournament; NaN for all others
    own_elo: dict[str, NDArray[np.float64]]
    elo: EloRatings
    elo_scale: Scale  # one standard deviation over orders
    ratings: Ratings  # Bradley-Terry
    scale: Scale  # its 95 % intervals
    davidson: Ratings  # ties as outcomes of their own
    smooth: Curve | None
    smooth_scale: Scale | None
    win_maps: dict[str, tuple[RunMap, ...]]  # by method: the share of fights that the defender wins
    memory: dict[str, Memory]  # by lineage
    # of ALL and of each method among itself; None: no whole part
    cyclic: dict[str, CyclicShare | None]
    cyclic_part: dict[str, TournamentResult]
    nash: NashAverage | None  # of the part without missing cells
    nash_part: TournamentResult
    alpha_rank: tuple[NDArray[Any], NDArray[Any]] | None  # its marginals in the same part
    populations: dict[str, PopulationValue]
    endings: tuple[Endings, Endings]  # by role
    missing: tuple[str, ...]  # sentences

    @property
    def entrants(self) -> tuple[Entrant, ...]:
        """All players [P]."""
        return (*self.result.defenders, *self.result.attackers)


def study(result: TournamentResult, effort: Effort | None = None) -> Study:
    """Compute everything. Degenerate results leave gaps that are named in `missing`."""
    effort = effort or Effort()
    table, rated = scores(result), first_episodes(result, min(ELO_EPISODES, result.cause.shape[2]))
    entrants = (*result.defenders, *result.attackers)
    methods = tuple(
        dict.fromkeys(entrant.method for _, entrant in showings(entrants) if entrant.lineage)
    )
    counts = (table.wins, table.losses, table.ties)
    ratings = bradley_terry(*counts)
    smooth = (
        random_walk_curve(*counts, timelines(result)) if len(entrants) <= LARGEST_CURVE else None
    )
    elo = elo_ratings(rated, effort.orders)
    points = np.concatenate([elo.defender, elo.attacker])
    spread = np.concatenate([elo.defender_spread, elo.attacker_spread])
    maps = run_maps(result, win_rate(result))
    parts = {ALL: _by_identity(complete_part(result))}
    if len(methods) > 1:
        parts |= {
            method: _by_identity(complete_part(_of_method(result, method))) for method in methods
        }
    whole = parts[ALL]
    rate = score_rate(whole)
    small = whole.played.size * sum(whole.played.shape) <= LARGEST_ALPHA_RANK
    rank = alpha_rank(rate) if rate.size and small else None
    own = {method: _members(whole.defenders, method) for method in methods}
    populations = {
        method: members for method, members in own.items() if len(members) and whole.played.size
    }
    return Study(
        result=result,
        methods=methods,
        own_elo=own_elo(rated, effort.orders),
        elo=elo,
        elo_scale=_scale(ratings, points, points - spread, points + spread),
        ratings=ratings,
        scale=_scale(ratings, ratings.rating, ratings.low, ratings.high),
        davidson=davidson(*counts),
        smooth=smooth,
        smooth_scale=smooth
        and _scale(ratings, smooth.ratings.rating, smooth.ratings.low, smooth.ratings.high),
        win_maps={
            method: tuple(run_map for run_map in maps if run_map.method == method)
            for method in methods
        },
        memory=memories(result),
        cyclic={name: _cyclic(part, effort) for name, part in parts.items()},
        cyclic_part=parts,
        nash=nash_average(rate) if rate.size else None,
        nash_part=whole,
        alpha_rank=None if rank is None else (rank.defender, rank.attacker),
        populations=population_values(whole, populations, effort.value_samples),
        endings=(endings(result, DEFENDER), endings(result, ATTACKER)),
        missing=tuple(missing(result, ratings, smooth, whole)),
    )


def own_elo(result: TournamentResult, orders: int) -> dict[str, NDArray[np.float64]]:
    """Elo [P] in every run's own tournament, by lineage, as in the paper; NaN for whoever takes no
    part in it.
    """
    num_defenders, total = len(result.defenders), sum(result.played.shape)
    trainings = [by_training(side) for side in _sides(result)]
    ratings = {}
    for lineage in trainings[DEFENDER]:
        rows, columns = (
            np.unique([i for i, _ in side.get(lineage, ())]).astype(int) for side in trainings
        )
        part = select(result, rows, columns)
        if part.played.any():
            elo = elo_ratings(part, orders)
            ratings[lineage] = np.full(total, np.nan)
            ratings[lineage][rows] = np.where(elo.defender_games > 0, elo.defender, np.nan)
            ratings[lineage][num_defenders + columns] = np.where(
                elo.attacker_games > 0, elo.attacker, np.nan
            )
    return ratings


def own_elo_by_side(
    study: Study,
) -> list[tuple[str, tuple[Entrant, ...], dict[str, NDArray[np.float64]]]]:
    """Role, entrants and their Elo by lineage, each [D] or [A]."""
    cut = len(study.result.defenders)
    parts = zip(SIDES, _sides(study.result), (slice(cut), slice(cut, None)), strict=True)
    return [
        (role, side, {run: elo[part] for run, elo in study.own_elo.items()})
        for role, side, part in parts
    ]


def _scale(ratings: Ratings, *numbers: NDArray[Any]) -> Scale:
    return Scale(*(np.where(ratings.design.games > 0, values, np.nan) for values in numbers))


def memories(result: TournamentResult) -> dict[str, Memory]:
    """The `Memory` of every run that has both roles in the tournament, by lineage."""
    memories = {}
    for run_map in run_maps(result):
        known = ~np.isnan(run_map.score)
        kept = np.flatnonzero(known.any(axis=0) | known.any(axis=1))
        if len(kept):
            score = run_map.score[np.ix_(kept, kept)]
            away = home_and_away(result, run_map.run)
            memories[run_map.run] = Memory(forgetting(score), forgetting(1.0 - score.T), *away)
    return memories


def _by_identity(part: TournamentResult) -> TournamentResult:
    """The same result with its entrants sorted by identity, so that random numbers do not depend on
    the order in which they were listed.
    """
    return select(
        part,
        *(
            np.argsort([entrant.identity for entrant in side], kind="stable")
            for side in _sides(part)
        ),
    )


def _cyclic(part: TournamentResult, effort: Effort) -> CyclicShare | None:
    table = scores(part)
    return (
        cyclic_share(table.wins, table.losses, table.ties, effort.bootstrap)
        if part.played.size
        else None
    )


def _of_method(result: TournamentResult, method: str) -> TournamentResult:
    return select(result, *(_members(side, method) for side in _sides(result)))


def _members(entrants: Sequence[Entrant], method: str) -> NDArray[np.integer]:
    return np.unique(
        [i for i, entrant in showings(entrants) if entrant.lineage and entrant.method == method]
    ).astype(int)


def _sides(result: TournamentResult) -> tuple[tuple[Entrant, ...], tuple[Entrant, ...]]:
    return result.defenders, result.attackers
