"""A planted tournament of IPPO and S-IPPO in which each of the paper's claims is true or false as
asked.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import expit
from tournaments import entrants, from_rates

from dronecombat_jax.analysis.panel import cross_play_cells
from dronecombat_jax.analysis.result import TournamentResult, tournament_result
from dronecombat_jax.types import Cause

METHODS = ("ippo", "s-ippo")


class Truth(NamedTuple):
    """What is planted, in log-odds of the defender's win; all 0: equal methods, steady seeds."""

    ahead: float = 0.0  # attackers above defenders
    diagonal: float = 0.0  # of IPPO's defenders against their own run's attackers of their time
    decline: float = 0.0  # of IPPO's late defenders
    early: float = 0.0  # of S-IPPO's defenders against attackers of the first half
    gap: float = 0.0  # of S-IPPO's final defenders against everybody
    spread: tuple[float, float] = (0.05, 0.05)  # sd over seeds of the defenders of each method
    improve: float = 0.0  # of both sides, from the first chunk to the last
    weaker: float = 0.0  # S-IPPO's attackers below IPPO's


def planted_claims(
    truth: Truth, seeds: int = 8, chunks: int = 10, episodes: int = 40, seed: int = 0
) -> TournamentResult:
    """All cells of `cross_play_cells` with every second chunk, drawn by `truth`."""
    rng = np.random.default_rng(seed)
    sides = [entrants(role, seeds, chunks, METHODS) for role in "da"]
    lift = {one.lineage: rng.normal(0, truth.spread[one.method == METHODS[1]]) for one in sides[0]}
    x = np.zeros((len(sides[0]), len(sides[1])))
    for i, one in enumerate(sides[0]):
        second, mine = one.method == METHODS[1], one.chunk / chunks
        for j, other in enumerate(sides[1]):
            theirs = other.chunk / chunks
            x[i, j] = truth.improve * (mine - theirs) - truth.ahead + lift[one.lineage]
            x[i, j] += truth.weaker * (other.method == METHODS[1])
            near = one.lineage == other.lineage and abs(one.chunk - other.chunk) <= chunks // 10
            x[i, j] += truth.diagonal * (near and not second)
            x[i, j] -= truth.decline * (mine > 0.6 and not second)
            x[i, j] += truth.early * (theirs <= 0.5 and second)
            x[i, j] += truth.gap * (one.chunk == chunks and second)
    drawn = from_rates(expit(x), episodes, seed, defenders=sides[0], attackers=sides[1])
    asked = cross_play_cells(*sides, every=2)[..., None]
    cause = np.where(asked, drawn.cause, Cause.NONE)
    steps = np.where(asked, drawn.steps, 0)
    return tournament_result(cause, steps, drawn.winner, sides[0], sides[1], drawn.control_dt)
