"""Does one method's final defender beat another's? Runs meet in ONE tournament, and each run gives
one number.

Ratings of two tournaments cannot be compared: with identical defenders, weaker attackers alone lift
the final one.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logit
from scipy.stats import t as student

from dronecombat_jax.analysis.bradley_terry import POINTS
from dronecombat_jax.analysis.panel import EVERY, Panel, away_panel
from dronecombat_jax.analysis.permutation import holm, permutation_test
from dronecombat_jax.analysis.result import TournamentResult, showings

MARGIN = 25.0  # points: methods closer than this are called equivalent
LEVEL = 0.05


class Welch(NamedTuple):
    """Difference of two means without assuming equal variances."""

    difference: float
    error: float  # standard error; NaN for fewer than two seeds in a sample
    freedom: float
    low: float  # 95 % interval
    high: float


class Comparison(NamedTuple):
    """One method against another; differences are first minus second."""

    first: str
    second: str
    seeds: tuple[int, int]  # runs that count
    fights: int  # fewest behind one seed's score
    # runs of the two methods left out because their final defender did not play
    missing: tuple[str, ...]
    adjusted_score: Welch  # of the adjusted scores (`panel`), which all numbers below are of, too
    plain_score: Welch  # of the mean scores away, for information: tilted (see `panel`)
    p_value: float  # primary: exact permutation test of the adjusted scores
    adjusted_p: float  # Holm's, over all pairs of methods compared at once
    exact: bool
    effect: float  # Cohen's d with the pooled standard deviation
    # 95 % interval of the score's difference for other runs on both sides
    new_attackers: tuple[float, float]
    elo: Welch  # the same in points: the score's logit
    equivalence_p: float  # that |difference| < MARGIN, by two one-sided tests
    adjusted_equivalence_p: float  # Holm's
    verdict: str

    @property
    def in_order(self) -> tuple[str, str]:
        """The two methods, the one with the better adjusted score first."""
        ahead = self.adjusted_score.difference > 0
        return (self.first, self.second) if ahead else (self.second, self.first)


def compare_methods(
    result: TournamentResult,
    methods: Sequence[str] | None = None,
    seed: int = 0,
    every: int = EVERY,
) -> list[Comparison]:
    """Compare every pair of `methods` (default: all that trained a defender, by name) on the common
    `away_panel`.

    Holm's correction goes over all pairs, for the differences and for the equivalences.
    """
    panel = away_panel(result, every)
    known = sorted(
        {defender.method for _, defender in showings(result.defenders) if defender.lineage}
    )
    methods = known if methods is None else list(methods)
    comparisons = [_compare(panel, *pair, seed) for pair in combinations(methods, 2)]
    differ = holm([comparison.p_value for comparison in comparisons]).tolist()
    equal = holm([comparison.equivalence_p for comparison in comparisons]).tolist()
    judged = [
        comparison._replace(adjusted_p=p, adjusted_equivalence_p=q)
        for comparison, p, q in zip(comparisons, differ, equal, strict=True)
    ]
    return [comparison._replace(verdict=_verdict(comparison)) for comparison in judged]


def welch(first: NDArray[Any], second: NDArray[Any], level: float = LEVEL) -> Welch:
    """Welch's interval for the difference of the means of `first` [n] and `second` [m]."""
    first, second = np.asarray(first, float), np.asarray(second, float)
    difference = float(first.mean() - second.mean())
    if min(len(first), len(second)) < 2:
        return Welch(difference, np.nan, np.nan, np.nan, np.nan)
    parts = [sample.var(ddof=1) / len(sample) for sample in (first, second)]
    freedom = sum(parts) ** 2 / max(
        sum(p**2 / (len(s) - 1) for p, s in zip(parts, (first, second), strict=True)), 1e-300
    )
    freedom = freedom if sum(parts) > 0 else float(len(first) + len(second) - 2)
    error = float(np.sqrt(sum(parts)))
    reach = float(student.ppf(1 - level / 2, freedom)) * error
    return Welch(difference, error, float(freedom), difference - reach, difference + reach)


def equivalence(first: NDArray[Any], second: NDArray[Any], margin: float = MARGIN) -> float:
    """p-value that the means differ by less than `margin`: the larger of two one-sided Welch tests
    (TOST).
    """
    at = welch(first, second)
    if np.isnan(at.error):
        return float("nan")
    room = margin - abs(at.difference)
    if at.error == 0.0:
        return 0.0 if room > 0 else 1.0
    return float(student.sf(room / at.error, at.freedom))


def pigeonhole_interval(
    panel: Panel, first: str, second: str, samples: int = 2000, seed: int = 0
) -> tuple[float, float]:
    """95 % interval of the difference of adjusted scores for new runs on both sides (Owen 2007).

    Each sample takes the runs anew as defenders, within each method, and independently as
    attackers, within each method; scripted pilots stay. The quantile is Student's with the seeds'
    freedom, and the variance is scaled by n / (n - 1).
    """
    methods = np.asarray(panel.methods)
    rows = [np.flatnonzero(methods == name) for name in (first, second)]
    fewest = min(map(len, rows))
    if fewest < 2:
        return float("nan"), float("nan")
    rng = np.random.default_rng(seed)
    groups = np.asarray(panel.group_methods)
    weight = np.ones((samples, len(groups)))
    for name in sorted(
        {name for name, run in zip(panel.group_methods, panel.groups, strict=True) if run}
    ):
        members = np.flatnonzero((groups == name) & np.asarray([bool(run) for run in panel.groups]))
        weight[:, members] = rng.multinomial(
            len(members), np.full(len(members), 1 / len(members)), samples
        )
    share = weight * panel.weights
    scored = share @ panel.filled.T / share.sum(axis=1, keepdims=True)  # [samples, R]
    means = []
    for members in rows:
        multiplicity = rng.multinomial(
            len(members), np.full(len(members), 1 / len(members)), samples
        )
        means.append((multiplicity * scored[:, members]).mean(axis=1))
    centre = panel.adjusted[rows[0]].mean() - panel.adjusted[rows[1]].mean()
    spread = np.std(means[0] - means[1]) * np.sqrt(fewest / (fewest - 1))
    reach = float(student.ppf(1 - LEVEL / 2, sum(map(len, rows)) - 2) * spread)
    return float(centre - reach), float(centre + reach)


def elo_of_score(score: NDArray[Any], fights: NDArray[Any]) -> NDArray[np.float64]:
    """How many points above its opponents a player must be to reach the mean `score`.

    Half a fight keeps 0 and 1 finite. An adjusted score may pass these ends, and counts as the end.
    """
    return POINTS * logit((np.clip(score, 0.0, 1.0) * fights + 0.5) / (fights + 1.0))


def _compare(panel: Panel, first: str, second: str, seed: int) -> Comparison:
    methods = np.asarray(panel.methods)
    chosen = [methods == first, methods == second]
    if not all(mask.any() for mask in chosen):
        absent = first if not chosen[0].any() else second
        raise ValueError(
            f"no run of method {absent!r} has a final defender on the panel; known: {sorted(set(methods))}"
        )
    scores = [panel.adjusted[mask] for mask in chosen]
    if not np.isfinite(np.concatenate(scores)).all():
        raise ValueError(f"runs of {first!r} and {second!r} met no attacker in common")
    elo = [elo_of_score(panel.adjusted[mask], panel.fights[mask]) for mask in chosen]
    test = permutation_test(scores[0], scores[1], seed=seed)
    freedom = sum(map(len, scores)) - 2
    pooled = np.sqrt(
        sum(np.sum((sample - sample.mean()) ** 2) for sample in scores) / max(freedom, 1)
    )
    return Comparison(
        first=first,
        second=second,
        seeds=(len(scores[0]), len(scores[1])),
        fights=int(min(panel.fights[mask].min() for mask in chosen)),
        missing=tuple(run for run, method in panel.missing if method in (first, second)),
        adjusted_score=welch(scores[0], scores[1]),
        plain_score=welch(panel.plain[chosen[0]], panel.plain[chosen[1]]),
        p_value=float(test.p_value),
        adjusted_p=np.nan,
        exact=test.exact,
        effect=float(test.difference / pooled) if pooled > 0 else np.nan,
        new_attackers=pigeonhole_interval(panel, first, second, seed=seed),
        elo=welch(elo[0], elo[1]),
        equivalence_p=equivalence(elo[0], elo[1]),
        adjusted_equivalence_p=np.nan,
        verdict="",
    )


def _verdict(comparison: Comparison) -> str:
    if comparison.adjusted_p < LEVEL:
        return " beats ".join(comparison.in_order)
    if comparison.adjusted_equivalence_p < LEVEL:
        return f"{comparison.first} and {comparison.second} are equivalent within {MARGIN:g} Elo"
    return f"undecided between {comparison.first} and {comparison.second}"
