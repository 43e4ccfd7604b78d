"""Does one method's final defender beat another's: the answer in one sentence that cannot be
misread.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.analysis.compare import LEVEL, MARGIN, Comparison, compare_methods
from dronecombat_jax.analysis.forgetting import AtHome, at_home
from dronecombat_jax.analysis.panel import EVERY, Panel, away_panel
from dronecombat_jax.analysis.permutation import holm, permutation_test, smallest_p, spread_test
from dronecombat_jax.analysis.result import TournamentResult
from dronecombat_jax.analysis.study import Memory, memories
from dronecombat_jax.errors import EXIT_DATA, UserError


class Secondary(NamedTuple):
    """One further question about two methods, by the exact permutation test."""

    measure: str
    difference: float  # first minus second
    p_value: float
    adjusted_p: float  # Holm's, over the secondary questions of this pair
    seeds: tuple[int, int]


class Answer(NamedTuple):
    """One pair of methods."""

    numbers: Comparison
    means: tuple[float, float]  # mean adjusted score of the final defenders
    sentence: str
    secondary: tuple[Secondary, ...]


class Verdict(NamedTuple):
    """All pairs of methods in one tournament."""

    answers: tuple[Answer, ...]
    panel: Panel
    every: int  # chunks between a run's attackers on the panel
    fights: int  # of the whole tournament


def judge(
    result: TournamentResult, methods: Sequence[str] | None = None, every: int = EVERY
) -> Verdict:
    """Compare all pairs of `methods` (default: all). UserError where there are not two with a final
    defender.

    `every`: which attackers of a run sit on the panel beside its final one.
    """
    panel = away_panel(result, every)
    known = sorted(set(panel.methods))
    chosen = known if methods is None else list(methods)
    if absent := sorted(set(chosen) - set(known)):
        left_out = sorted(run for run, method in panel.missing if method in absent)
        raise UserError(
            f"no final defender of {', '.join(absent)} met the common attackers: {left_out}",
            EXIT_DATA,
        )
    if len(chosen) < 2:
        raise UserError(
            f"nothing to compare: all final defenders are of {', '.join(chosen) or 'nobody'}",
            EXIT_DATA,
        )
    if not np.isfinite(panel.adjusted).all():
        reason = "no attacker met the final defenders of two runs but its own: nothing to compare"
        raise UserError(reason, EXIT_DATA)
    remembered, own = memories(result), at_home(result, panel)
    answers = []
    compared = compare_methods(result, chosen, every=every)
    for comparison in compared:
        of = np.asarray(panel.methods)
        scores = [panel.adjusted[of == method] for method in (comparison.first, comparison.second)]
        means = (float(scores[0].mean()), float(scores[1].mean()))
        more = secondary(panel, remembered, own, comparison.first, comparison.second)
        answers.append(Answer(comparison, means, sentence(comparison, means, len(compared)), more))
    return Verdict(tuple(answers), panel, every, int(result.played.sum()) * result.cause.shape[2])


def sentence(comparison: Comparison, means: tuple[float, float], pairs: int = 1) -> str:
    """The answer; `pairs`: how many pairs Holm's correction covers."""
    test = f"{'exact' if comparison.exact else 'sampled'} permutation p = {comparison.adjusted_p:.2g}{' after Holm' * (pairs > 1)}"
    seeds = f"{comparison.seeds[0]} v {comparison.seeds[1]} training seeds"
    if comparison.adjusted_p < LEVEL:
        ahead = comparison.adjusted_score.difference > 0
        winner, loser = comparison.in_order
        high, low = means if ahead else means[::-1]
        ends = (comparison.adjusted_score.low, comparison.adjusted_score.high)
        ends = ends if ahead else (-ends[1], -ends[0])
        text = (
            f"YES: {winner}'s final defender beats {loser}'s. Against attackers that it never "
            f"trained with, the same for both, it scores {high:.3f}, {loser}'s {low:.3f}: "
            f"{_signed(high - low)}, 95 % interval {_signed(ends[0])} to {_signed(ends[1])} "
            f"({test}, {seeds})."
        )
        if not comparison.new_attackers[0] * comparison.new_attackers[1] > 0:
            text += " That is against these attackers; with newly trained ones the difference may vanish."
        return text
    if comparison.adjusted_equivalence_p < LEVEL:
        return (
            f"NO DIFFERENCE OF {MARGIN:g} ELO: the final defenders of {comparison.first} and {comparison.second} are equivalent within that "
            f"margin (two one-sided tests, p = {comparison.adjusted_equivalence_p:.2g}{' after Holm' * (pairs > 1)}; {test} for a "
            f"difference, {seeds})."
        )
    margin = (
        "could not be tested"
        if np.isnan(comparison.adjusted_equivalence_p)
        else f"is not shown either (p = {comparison.adjusted_equivalence_p:.2g})"
    )
    text = (
        f"UNDECIDED: no difference between the final defenders of {comparison.first} and {comparison.second} is shown ({test}, {seeds}), "
        f"and that they are equal within {MARGIN:g} Elo {margin}. This is not evidence that they are equal."
    )
    if (least := smallest_p(*comparison.seeds) * pairs) >= LEVEL:
        text += f" With {seeds} no result could have been significant: the smallest possible p is {min(least, 1.0):.2g}."
    return text


def secondary(
    panel: Panel, memory: dict[str, Memory], own: dict[str, AtHome], first: str, second: str
) -> tuple[Secondary, ...]:
    """Spread over seeds and forgetting, as far as the tournament tells them."""
    methods, runs = np.asarray(panel.methods), np.asarray(panel.runs)
    measures = {
        "backward transfer": {run: item.defender.backward_transfer for run, item in memory.items()},
        "worst case against the own past, adjusted": {run: fate.worst for run, fate in own.items()},
        "home minus away, adjusted": {run: fate.advantage for run, fate in own.items()},
    }
    tests = []
    for name, values in measures.items():
        first_values, second_values = (
            _known(values, runs[methods == method]) for method in (first, second)
        )
        if len(first_values) and len(second_values):
            tests.append(
                (
                    name,
                    permutation_test(first_values, second_values),
                    (len(first_values), len(second_values)),
                )
            )
    first_values, second_values = (panel.adjusted[methods == method] for method in (first, second))
    tests.append(
        (
            "spread of the score over seeds",
            spread_test(first_values, second_values),
            (len(first_values), len(second_values)),
        )
    )
    adjusted = holm([float(test.p_value) for _, test, _ in tests])
    return tuple(
        Secondary(name, float(test.difference), float(test.p_value), float(p), seeds)
        for (name, test, seeds), p in zip(tests, adjusted, strict=True)
    )


def _known(values: dict[str, float], runs: NDArray[Any]) -> NDArray[np.float64]:
    """The finite values of `runs`."""
    known = np.asarray([values[run] for run in runs if run in values], float)
    return known[np.isfinite(known)]


def _signed(value: float) -> str:
    return "unknown" if np.isnan(value) else f"{value:+.3f}"
