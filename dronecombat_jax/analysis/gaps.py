"""What a tournament lacks, in words: nothing missing is made up, and nothing missing goes unsaid."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.analysis.bradley_terry import Ratings
from dronecombat_jax.analysis.design import BOUNDED
from dronecombat_jax.analysis.random_walk import Curve, timelines
from dronecombat_jax.analysis.result import TournamentResult, showings


def missing(
    result: TournamentResult, ratings: Ratings, smooth: Curve | None, whole: TournamentResult
) -> list[str]:
    """What the tournament lacks, one sentence each."""
    lines = []
    cells, absent = result.played.size, int(np.sum(~result.played))
    if absent:
        lines.append(f"{absent} of {cells} cells were not played: grey in the maps, in no average.")
        lines.append(
            f"Nash averaging, population values and the cyclic share use the part without missing cells: "
            f"{whole.played.shape[0]} of {result.played.shape[0]} defenders, "
            f"{whole.played.shape[1]} of {result.played.shape[1]} attackers."
        )
    for role, side, played in zip(
        ("defender", "attacker"), (result.defenders, result.attackers), _played(result), strict=True
    ):
        if idle := [entrant.label for entrant, some in zip(side, played, strict=True) if not some]:
            lines.append(f"{_listed(idle)}: no fight as {role}, so no rating.")
    lines += _missing_seeds(result)
    ends = int(np.sum(ratings.design.bound != BOUNDED))
    if ends:
        lines.append(
            f"{ends} of {len(ratings.rating)} ratings are open to one side or both (unbeaten, winless or without "
            "fights): the stated prior keeps them finite, their interval has no end there."
        )
    if (parts := len(np.unique(ratings.design.component))) > 1:
        lines.append(
            f"The entrants fall into {parts} groups that never met: ratings of two groups cannot be compared."
        )
    if smooth is None:
        lines.append("Too many entrants for the smoothed curve.")
    elif smooth.at_limit and any(len(chain.players) > 1 for chain in timelines(result)):
        lines.append(
            "The smoothed curve's step found no optimum: it is all but constant, or not smoothed at all."
        )
    return lines


def seeds_of(result: TournamentResult) -> dict[str, int]:
    """How many training seeds of each method fought."""
    lineages: dict[str, set[str]] = {}
    for side, played in zip((result.defenders, result.attackers), _played(result), strict=True):
        for index, entrant in showings(side):
            if entrant.lineage:
                lineages.setdefault(entrant.method, set()).update(
                    {entrant.lineage} if played[index] else ()
                )
    return {method: len(members) for method, members in lineages.items()}


def _missing_seeds(result: TournamentResult) -> list[str]:
    """Seeds without a fight, fewer seeds of one method than of another, seeds that are there in one
    role only.
    """
    listed: dict[str, set[str]] = {}
    fought: list[set[str]] = []
    for side, played in zip((result.defenders, result.attackers), _played(result), strict=True):
        for _, entrant in showings(side):
            if entrant.lineage:
                listed.setdefault(entrant.method, set()).add(entrant.lineage)
        fought.append(
            {
                entrant.lineage
                for index, entrant in showings(side)
                if played[index] and entrant.lineage
            }
        )
    flown = fought[0] | fought[1]
    lines = [
        f"{method}: only {len(seeds & flown)} of {len(seeds)} training seeds fought; missing {_listed(sorted(seeds - flown))}."
        for method, seeds in listed.items()
        if seeds - flown
    ]
    counts = {method: len(seeds & flown) for method, seeds in listed.items()}
    if len(set(counts.values())) > 1:
        lines.append(
            "Unequal numbers of training seeds: "
            + ", ".join(f"{item} {n}" for item, n in counts.items())
            + "."
        )
    for role, lacking in (
        ("attackers", fought[0] - fought[1]),
        ("defenders", fought[1] - fought[0]),
    ):
        if lacking:
            lines.append(
                f"{_listed(sorted(lacking))}: no {role} fought, so no map of the run by itself."
            )
    return lines


def _played(result: TournamentResult) -> tuple[NDArray[Any], NDArray[Any]]:
    return np.atleast_1d(result.played.any(axis=1)), np.atleast_1d(result.played.any(axis=0))


def _listed(names: Sequence[str], most: int = 8) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
