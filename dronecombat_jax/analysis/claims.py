"""The paper's six claims, decided from one tournament of all runs, one number a training seed.

Every number is written so that above 0 is what the paper says. What does not live here: the table
(`claims_text`), what each number is made of (`claim_measures`), and what the paper's two separate
pools can tell (`protocol`).
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from dronecombat_jax.analysis import claim_measures as measures
from dronecombat_jax.analysis.compare import LEVEL, elo_of_score, welch
from dronecombat_jax.analysis.panel import EVERY, Panel, away_panel
from dronecombat_jax.analysis.permutation import (
    holm,
    permutation_test,
    sign_flip_test,
    smallest_p,
)
from dronecombat_jax.analysis.result import TournamentResult

IPPO, SIPPO = "ippo", "s-ippo"
# Holm's correction goes over each: what is said of IPPO alone; the primary question, which stands
# alone as in `compare`; what else is said of the two methods.
FAMILIES = ((0, 1, 2), (4,), (3, 5))
PAPER_GAP = 100.0  # points: 1450 - 1350
GAP = "final_gap"  # the claim with a size
AGREES, DISAGREES, UNDECIDED = "agrees", "disagrees", "undecided"
SMALLER = "agrees, but smaller"  # there is a difference, and it is less than the paper's


class Claim(NamedTuple):
    """One claim and what our seeds say; numbers above 0 agree with the paper."""

    name: str
    claim: str
    paper: str  # what the paper reports
    measure: str  # our number, one a seed
    unit: str
    values: Mapping[str, NDArray[np.float64]]  # by method, [S] one a seed
    estimate: float  # mean over seeds, or difference of two means
    low: float  # 95 % interval, of this claim alone
    high: float
    test: str
    p_value: float
    adjusted_p: float  # Holm's, over the claim's family
    family: int  # how many claims that are
    least_p: float  # the smallest p-value that so many seeds can give, before Holm
    by_protocol: float  # the same number as the paper computes it; NaN: it is `estimate`
    verdict: str


def paper_claims(
    result: TournamentResult, own_elo: Mapping[str, NDArray[Any]], every: int = EVERY
) -> tuple[Claim, ...]:
    """Decide all six claims, in the paper's order; () where the tournament lacks one of the two
    methods.

    `own_elo`: of `study.own_elo`, each run rated in its own tournament; `every`: as in
    `panel.away_panel`. A claim whose numbers nobody played is undecided, with NaN.
    """
    panel = away_panel(result, every)
    if not {IPPO, SIPPO} <= set(panel.methods):
        return ()
    claims = [
        _attackers_ahead(result, own_elo),
        _near_the_diagonal(result),
        _late_decline(result),
        _early_attackers(result, every),
        _final_gap(result, own_elo, panel),
        _varies_more(result),
    ]
    for family in FAMILIES:
        corrected = holm([claims[member].p_value for member in family]).tolist()
        for member, p_value in zip(family, corrected, strict=True):
            claim = claims[member]._replace(adjusted_p=p_value, family=len(family))
            claims[member] = claim._replace(verdict=_verdict(claim))
    return tuple(claims)


def _attackers_ahead(result: TournamentResult, own_elo: Mapping[str, NDArray[Any]]) -> Claim:
    return _one_method(
        "attackers_ahead",
        "IPPO's attackers rate above its defenders",
        "attackers above defenders all through training (figure 4)",
        "mean Elo of a run's attackers minus that of its defenders, in its own tournament",
        "Elo",
        measures.attackers_ahead(result, own_elo, IPPO),
    )


def _near_the_diagonal(result: TournamentResult) -> Claim:
    return _one_method(
        "near_the_diagonal",
        "IPPO's defenders do best against attackers of their own time",
        '"marginally higher win rates" near the diagonal (figure 6)',
        "mean score beyond what both ratings predict: attackers within a tenth of the training "
        "minus all others",
        "score",
        measures.near_the_diagonal(result, IPPO),
    )


def _late_decline(result: TournamentResult) -> Claim:
    return _one_method(
        "late_decline",
        "IPPO's defenders decline late in training",
        '"a marked decline beyond approximately 600 million" of 1000 million steps (figure 6)',
        "win rate against the attackers of the first 0.6 of the training: defenders of 0.3 to 0.6 "
        "minus those after 0.6",
        "win rate",
        measures.late_decline(result, IPPO),
    )


def _early_attackers(result: TournamentResult, every: int) -> Claim:
    early = away_panel(measures.early_part(result), every)
    values = {method: _of(early, early.adjusted, method) for method in (IPPO, SIPPO)}
    claim = _two_methods(
        "early_attackers",
        "S-IPPO's defenders do better against early attackers",
        '"higher win rates against earlier attacker checkpoints" (figure 7)',
        "score of the final defender against attackers of the first half of other runs' training, "
        "the same for all",
        "score",
        values,
    )
    own = [measures.own_past(result, method) for method in (SIPPO, IPPO)]
    return claim._replace(by_protocol=_mean(own[0]) - _mean(own[1]))


def _final_gap(
    result: TournamentResult, own_elo: Mapping[str, NDArray[Any]], panel: Panel
) -> Claim:
    elo = elo_of_score(panel.adjusted, panel.fights)
    claim = _two_methods(
        GAP,
        "S-IPPO's final defender is 100 Elo above IPPO's",
        "1450 and 1350, each method in pools of its own",
        "rating of the final defender against the common panel of other runs' attackers and "
        "scripted pilots",
        "Elo",
        {method: _of(panel, elo, method) for method in (IPPO, SIPPO)},
    )
    own = [measures.final_own_elo(result, own_elo, method) for method in (SIPPO, IPPO)]
    return claim._replace(by_protocol=_mean(own[0]) - _mean(own[1]))


def _varies_more(result: TournamentResult) -> Claim:
    claim = _two_methods(
        "varies_more",
        "S-IPPO varies more between seeds",
        '"a higher variance in win rates" (figures 8, 9)',
        "mean distance of a seed's win-rate map from the median map of its method",
        "win rate",
        {method: measures.distance_from_median(result, method) for method in (IPPO, SIPPO)},
    )
    if min(map(len, claim.values.values())) < 3:  # of two seeds both are as far from their median
        return claim._replace(low=np.nan, high=np.nan)
    return claim


def _one_method(
    name: str, claim: str, paper: str, measure: str, unit: str, values: NDArray[Any]
) -> Claim:
    """A claim about IPPO alone: are the seeds' values above 0?"""
    seeds = len(values)
    test, p_value, ends, estimate = "not played", np.nan, (np.nan, np.nan), np.nan
    if seeds:
        flipped = sign_flip_test(values)
        estimate, p_value, ends = float(values.mean()), float(flipped.p_value), _student(values)
        test = f"{'exact' if flipped.exact else 'sampled'} sign-flip test, {seeds} seeds"
    return Claim(
        name, claim, paper, measure, unit, {IPPO: values}, estimate, *ends, test, p_value, np.nan, 1,
        min(2.0 ** (1 - seeds), 1.0), np.nan, UNDECIDED,
    )  # fmt: skip


def _two_methods(
    name: str,
    claim: str,
    paper: str,
    measure: str,
    unit: str,
    values: Mapping[str, NDArray[Any]],
) -> Claim:
    """A claim that S-IPPO's values are above IPPO's."""
    second, first = values[SIPPO], values[IPPO]
    test, p_value, ends, estimate, least = "not played", np.nan, (np.nan, np.nan), np.nan, 1.0
    if len(first) and len(second):
        moved = permutation_test(second, first)
        at = welch(second, first)
        estimate, p_value, ends = at.difference, float(moved.p_value), (at.low, at.high)
        kind = "exact" if moved.exact else "sampled"
        test = f"{kind} permutation test, {len(second)} v {len(first)} seeds"
        least = smallest_p(len(second), len(first))
    return Claim(
        name, claim, paper, measure, unit, values, estimate, *ends, test, p_value, np.nan, 1, least,
        np.nan, UNDECIDED,
    )  # fmt: skip


def _verdict(claim: Claim) -> str:
    decided = claim.adjusted_p < LEVEL
    if claim.name == GAP and claim.estimate < PAPER_GAP and _p_of_the_papers_gap(claim) < LEVEL:
        return SMALLER if decided and claim.estimate > 0 else DISAGREES
    if not decided:
        return UNDECIDED
    return AGREES if claim.estimate > 0 else DISAGREES


def _p_of_the_papers_gap(claim: Claim) -> float:
    """p-value of the hypothesis that the gap is PAPER_GAP: the gap is subtracted, then seeds are
    relabelled.
    """
    first, second = claim.values[IPPO], claim.values[SIPPO]
    if not len(first) or not len(second):
        return float("nan")
    return float(permutation_test(second - PAPER_GAP, first).p_value)


def _student(values: NDArray[Any]) -> tuple[float, float]:
    """95 % interval of the mean of one number a seed; NaN for fewer than two."""
    if len(values) < 2:
        return float("nan"), float("nan")
    reach = student.ppf(1 - LEVEL / 2, len(values) - 1) * values.std(ddof=1) / len(values) ** 0.5
    return float(values.mean() - reach), float(values.mean() + reach)


def _of(panel: Panel, values: NDArray[Any], method: str) -> NDArray[np.float64]:
    """The finite values of a method's seeds."""
    chosen = values[np.asarray(panel.methods) == method] if len(values) else values
    return chosen[np.isfinite(chosen)]


def _mean(values: NDArray[Any]) -> float:
    return float(values.mean()) if len(values) else float("nan")
