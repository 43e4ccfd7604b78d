"""A verdict with all its numbers: as text for a person, and as plain data."""

from typing import Any

from dronecombat_jax.analysis.compare import LEVEL, MARGIN, Welch
from dronecombat_jax.analysis.permutation import smallest_p
from dronecombat_jax.analysis.verdict import Answer, Verdict


def verdict_text(verdict: Verdict) -> str:
    """All answers for a person, with their numbers."""
    blocks = [_block(answer) for answer in verdict.answers]
    panel = verdict.panel
    seats = f"{int(panel.weights.sum())} attackers of {len(panel.groups)} runs and pilots"
    notes = [
        f"common panel: {seats}: of each run the final one and every {_nth(verdict.every)} chunk's, and the scripted "
        f"pilots; never a run's own; {verdict.fights:,} fights in the tournament"
    ]
    if len(set(panel.steps)) > 1:
        notes.append(
            f"unequal training: {min(panel.steps):,} to {max(panel.steps):,} steps; compared as they are"
        )
    if panel.missing:
        notes.append(
            f"left out, too few of their fights were played: {', '.join(run for run, _ in panel.missing)}"
        )
    notes += [
        f"{run} ends with the same defender as {first}: no second seed, not counted"
        for run, first in panel.copies
    ]
    if panel.dropped:
        notes.append(
            f"{len(panel.dropped)} attackers left out of the panel, some defender did not meet them"
        )
    return "\n\n".join([*blocks, "\n".join(notes)])


def verdict_json(verdict: Verdict) -> dict[str, Any]:
    """The same as plain data; NaN is left for `tables.to_json` to turn into null."""
    panel = verdict.panel
    return {
        "question": "does one method's final defender score better against attackers that it never trained with?",
        "level": LEVEL,
        "margin_elo": MARGIN,
        "comparisons": [
            {"sentence": answer.sentence, "mean_adjusted_score": _by_method(answer)}
            | {key: _tree(value) for key, value in answer.numbers._asdict().items()}
            | {"secondary": [measure._asdict() for measure in answer.secondary]}
            for answer in verdict.answers
        ],
        "seeds": [
            {
                "run": run,
                "method": panel.methods[row],
                "steps": panel.steps[row],
                "adjusted_score": float(panel.adjusted[row]),
                "plain_score": float(panel.plain[row]),
                "fights": int(panel.fights[row]),
            }
            for row, run in enumerate(panel.runs)
        ],
        "panel_every": verdict.every,
        "missing": [run for run, _ in panel.missing],
        "copies": [{"run": run, "same_as": first} for run, first in panel.copies],
        "attackers_left_out": list(panel.dropped),
        "fights": verdict.fights,
    }


def _block(answer: Answer) -> str:
    numbers = answer.numbers
    effect = _number(numbers.effect, "+.2f")
    lines = [
        answer.sentence,
        f"  adjusted score        {numbers.first} {answer.means[0]:.3f}   "
        f"{numbers.second} {answer.means[1]:.3f}   at least {numbers.fights:,} fights a seed; "
        "a win 1, a tie 1/2",
        f"{'':24}as if all had met all attackers; against a run's own, what both strengths predict",
        f"  differences are {numbers.first} minus {numbers.second}, with 95 % intervals:",
        f"  adjusted score        {_interval(numbers.adjusted_score)} Welch;  Cohen's d {effect}",
        f"  new attackers         {_ends(numbers.new_attackers)} pigeonhole bootstrap over both sides' runs",
        f"  Elo                   {_interval(numbers.elo, '.0f')} of the score's logit",
        f"  plain mean            {_interval(numbers.plain_score)} for information: "
        "tilted towards the method with the stronger attackers",
        f"  permutation p         {numbers.p_value:.4g}, Holm {numbers.adjusted_p:.4g} ({'all' if numbers.exact else 'a sample of'} relabellings; "
        f"least possible {smallest_p(*numbers.seeds):.2g})",
        f"  equivalence p         {_number(numbers.equivalence_p, '.4g')}, Holm {_number(numbers.adjusted_equivalence_p, '.4g')} "
        f"(within {MARGIN:g} Elo)",
        *(
            f"  secondary             {s.measure}: {s.difference:+.3f}, p {s.p_value:.3g}, Holm {s.adjusted_p:.3g}"
            for s in answer.secondary
        ),
    ]
    if numbers.missing:
        lines.append(f"  left out              {', '.join(numbers.missing)}")
    return "\n".join(lines)


def _by_method(answer: Answer) -> dict[str, float]:
    numbers = answer.numbers
    return dict(zip((numbers.first, numbers.second), answer.means, strict=True))


def _interval(welch: Welch, digits: str = ".3f") -> str:
    return f"{welch.difference:+{digits}} {_ends((welch.low, welch.high), digits)}"


def _ends(ends: tuple[float, float], digits: str = ".3f") -> str:
    return (
        f"[{ends[0]:+{digits}}, {ends[1]:+{digits}}]"
        if ends[0] == ends[0]
        else "[unknown: one seed a method]"
    )


def _number(value: float, digits: str) -> str:
    return f"{value:{digits}}" if value == value else "unknown"


def _nth(number: int) -> str:
    last = {1: "st", 2: "nd", 3: "rd"}.get(
        number % 10 if number % 100 not in (11, 12, 13) else 0, "th"
    )
    return f"{number}{last}"


def _tree(value: Any) -> Any:
    return value._asdict() if hasattr(value, "_asdict") else value
