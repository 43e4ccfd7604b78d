"""What the paper's protocol can tell: each method rated in pools of its own, then compared.

Three ways to a difference between final defenders: by chance (the same numbers under relabelled
seeds), by attackers that are weaker and nothing else (planted: fights drawn anew from the fitted
strengths), and by whose attackers a defender is rated with (real: the same defenders in other runs'
pools). What does not live here: the comparison in one tournament (`compare`, `claims`).
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from dronecombat_jax.analysis.bradley_terry import POINTS, bradley_terry
from dronecombat_jax.analysis.claim_measures import final_own_elo, own_maps
from dronecombat_jax.analysis.claims import IPPO, SIPPO
from dronecombat_jax.analysis.elo import elo_ratings
from dronecombat_jax.analysis.panel import EVERY, every_nth
from dronecombat_jax.analysis.permutation import permutation_test, relabellings
from dronecombat_jax.analysis.result import (
    Entrant,
    TournamentResult,
    by_training,
    scores,
    select,
    tournament_result,
)
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause

WEAKER = (0.0, 50.0, 100.0, 200.0, 300.0)  # points
ORDERS = 8  # of the fights, for each of many pools
PLANTED_EPISODES = 5  # a cell, as in the paper's ratings


class Protocol(NamedTuple):
    """Differences are S-IPPO minus IPPO, in Elo points, of final defenders."""

    own: Mapping[str, NDArray[np.float64]]  # by method, [S] Elo in its own pool
    difference: float  # as the paper computes it
    by_chance: NDArray[np.float64]  # [L] the same under every relabelling of the seeds
    p_value: float  # share of them that are as large
    weaker: NDArray[np.float64]  # [W] by how much all attackers are weakened
    lifted: NDArray[np.float64]  # [S, W] what that alone adds to IPPO's final defenders
    runs: tuple[str, ...]  # [R] whose final defenders, and whose attackers
    methods: tuple[str, ...]  # [R]
    # [R, R] Elo of each final defender (row) rated with another run's attackers (column); NaN where
    # they did not all meet
    pools: NDArray[np.float64]

    @property
    def by_attackers(self) -> float:
        """How much the same defenders' Elo rises with S-IPPO's attackers in place of IPPO's; own
        pools do not count.
        """
        others = np.where(np.eye(len(self.runs), dtype=bool), np.nan, self.pools)
        methods = np.asarray(self.methods)
        first, second = (_means(others[:, methods == method]) for method in (IPPO, SIPPO))
        return _mean(second - first)


def paper_protocol(
    result: TournamentResult,
    own_elo: Mapping[str, NDArray[Any]],
    every: int = EVERY,
    orders: int = ORDERS,
    seed: int = 0,
) -> Protocol | None:
    """Examine a tournament of both methods; None where either has no run rated by itself.

    `own_elo`: of `study.own_elo`; `every`: which chunks of a run met other runs; `orders`: of the
    fights, for Elo; `seed`: of the planted fights.
    """
    own = {method: final_own_elo(result, own_elo, method) for method in (IPPO, SIPPO)}
    if not all(map(len, own.values())):
        return None
    labels, _ = relabellings(len(own[SIPPO]), len(own[IPPO]))
    values = np.concatenate([own[SIPPO], own[IPPO]])
    chosen = labels.astype(float)
    by_chance = chosen @ values / chosen.sum(axis=1) - (1 - chosen) @ values / (1 - chosen).sum(
        axis=1
    )
    runs, methods, pools = _pools(result, every, orders)
    return Protocol(
        own=own,
        difference=float(by_chance[0]),
        by_chance=by_chance,
        p_value=float(permutation_test(own[SIPPO], own[IPPO]).p_value),
        weaker=np.asarray(WEAKER),
        lifted=_lifted(result, orders, seed),
        runs=runs,
        methods=methods,
        pools=pools,
    )


def protocol_json(protocol: Protocol) -> dict[str, Any]:
    """The numbers as plain data, without the list of relabellings."""
    return {
        "difference": protocol.difference,
        "p_value": protocol.p_value,
        "by_chance_95": np.quantile(protocol.by_chance, [0.025, 0.975]).tolist(),
        "own": {method: values.tolist() for method, values in protocol.own.items()},
        "weaker": protocol.weaker.tolist(),
        "lifted": protocol.lifted.tolist(),
        "by_attackers": protocol.by_attackers,
        "runs": list(protocol.runs),
        "pools": protocol.pools.tolist(),
    }


def _lifted(result: TournamentResult, orders: int, seed: int) -> NDArray[np.float64]:
    """The final defender's Elo minus that without weakening, [S, W], in every IPPO run's own pool.

    Fights are drawn from Bradley-Terry strengths fitted to the pool, by the same random numbers
    for every weakening.
    """
    rows = []
    for number, own in enumerate(own_maps(result, IPPO)):
        table = scores(own.part)
        rating = bradley_terry(table.wins, table.losses, table.ties).rating
        size = len(own.part.defenders)
        ahead = rating[:size, None] - rating[None, size:]
        chance = np.random.default_rng([seed, number]).random((*ahead.shape, PLANTED_EPISODES))
        elo = []
        for points in WEAKER:
            won = chance < expit((ahead + points) / POINTS)[..., None]
            elo.append(_final_elo(_planted(own.part, won), orders))
        rows.append(np.asarray(elo) - elo[0])
    return np.asarray(rows).reshape(-1, len(WEAKER))


def _planted(part: TournamentResult, won: NDArray[np.bool_]) -> TournamentResult:
    """The players of `part` with other fights, `won` [D, A, E] by the defender or lost."""
    cause = np.where(won, Cause.INTERCEPT, Cause.REACHED).astype(np.int8)
    return tournament_result(
        cause,
        np.ones(cause.shape, int),
        part.winner,
        part.defenders,
        part.attackers,
        part.control_dt,
    )


def _pools(
    result: TournamentResult, every: int, orders: int
) -> tuple[tuple[str, ...], tuple[str, ...], NDArray[np.float64]]:
    """Lineages [R], methods [R], and Elo [R, R] of final defenders among their own run's thinned
    defenders, rated with each run's thinned attackers.
    """
    sides = [
        {lineage: _thinned(saved, every) for lineage, saved in by_training(side).items()}
        for side in (result.defenders, result.attackers)
    ]
    methods = {
        lineage: saved[-1][1].method for lineage, saved in by_training(result.defenders).items()
    }
    runs = tuple(run for run in methods if methods[run] in (IPPO, SIPPO) and run in sides[ATTACKER])
    pools = np.full((len(runs), len(runs)), np.nan)
    for row, run in enumerate(runs):
        for column, other in enumerate(runs):
            part = select(result, sides[DEFENDER][run], sides[ATTACKER][other])
            if part.played.all():
                pools[row, column] = _final_elo(part, orders)
    return runs, tuple(methods[run] for run in runs), pools


def _thinned(saved: list[tuple[int, Entrant]], every: int) -> NDArray[np.integer]:
    """Indices of a run's players of every n-th chunk and the last, each once, the last at the end."""
    indices = [index for index, entrant in saved if every_nth(entrant, saved, every)]
    return np.asarray(list(dict.fromkeys(indices[::-1]))[::-1], int)


def _final_elo(part: TournamentResult, orders: int) -> float:
    return float(elo_ratings(part, orders).defender[-1])


def _means(values: NDArray[Any]) -> NDArray[np.float64]:
    """Mean [R] of the known values of each row; NaN without any."""
    return np.asarray([_mean(row[~np.isnan(row)]) for row in values])


def _mean(values: NDArray[Any]) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else float("nan")
