"""The paper's claims beside ours: a table for a person (Markdown), and plain data."""

from collections.abc import Sequence
from typing import Any

from dronecombat_jax.analysis.claims import PAPER_GAP, Claim
from dronecombat_jax.analysis.compare import LEVEL

COLUMNS = ("claim", "paper", "ours", "95 % interval", "test", "verdict")
DIGITS = {"Elo": ".0f"}


def claims_rows(claims: Sequence[Claim]) -> list[tuple[str, ...]]:
    """One row of `COLUMNS` a claim."""
    return [
        (
            f"{number}. {claim.claim}",
            claim.paper,
            _ours(claim),
            _interval(claim),
            _test(claim),
            claim.verdict.upper(),
        )
        for number, claim in enumerate(claims, 1)
    ]


def claims_notes(claims: Sequence[Claim]) -> list[str]:
    """How to read the table."""
    notes = [
        "Numbers above 0 are what the paper says. One number a training seed: "
        + "; ".join(f"({i}) {claim.measure}" for i, claim in enumerate(claims, 1))
        + ".",
        f"A claim is decided where p is below {LEVEL:g}, after Holm over claims 1, 2, 3 and over 4, 6; "
        f"claim 5 is the primary question and stands alone, also tested against {PAPER_GAP:g} points. "
        "Intervals are of each claim alone. Undecided is no evidence against a claim.",
    ]
    if hopeless := [
        str(i) for i, claim in enumerate(claims, 1) if claim.least_p * claim.family >= LEVEL
    ]:
        notes.append(
            f"With so few seeds claims {', '.join(hopeless)} may stay undecided whatever the fights "
            "say: the least possible p-value, times the claims of its family, is not below the level."
        )
    return notes


def claims_markdown(claims: Sequence[Claim]) -> str:
    """The table and its notes, for docs/results.md."""
    cell = lambda text: text.replace("|", "\\|")
    rows = [" | ".join(map(cell, row)) for row in claims_rows(claims)]
    head = [" | ".join(COLUMNS), "|".join("---" for _ in COLUMNS)]
    lines = [f"| {line} |" if "---" not in line else f"|{line}|" for line in [*head, *rows]]
    return "\n".join([*lines, "", *claims_notes(claims)]) + "\n"


def claims_json(claims: Sequence[Claim]) -> list[dict[str, Any]]:
    """The claims as plain data; `files.plain.to_json` writes NaN as null."""
    plain = lambda values: {method: list(map(float, seeds)) for method, seeds in values.items()}
    return [{**claim._asdict(), "values": plain(claim.values)} for claim in claims]


def _ours(claim: Claim) -> str:
    if claim.estimate != claim.estimate:
        return "not played"
    text = f"{_signed(claim, claim.estimate)} {claim.unit}"
    if claim.by_protocol == claim.by_protocol:
        text += f" ({_signed(claim, claim.by_protocol)} as the paper computes it)"
    return text


def _interval(claim: Claim) -> str:
    if claim.low != claim.low:
        return "unknown"
    return f"{_signed(claim, claim.low)} to {_signed(claim, claim.high)}"


def _test(claim: Claim) -> str:
    if claim.p_value != claim.p_value:
        return claim.test
    holm = f", Holm {claim.adjusted_p:.2g}" if claim.family > 1 else ""
    return f"{claim.test}: p = {claim.p_value:.2g}{holm}"


def _signed(claim: Claim, value: float) -> str:
    return f"{value:+{DIGITS.get(claim.unit, '.3f')}}"
