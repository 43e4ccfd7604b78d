"""The robustness of a tournament's players as a table in Markdown."""

from collections.abc import Mapping
from typing import Any

from dronecombat_jax.config.schema import one_line

HEAD = (
    "| gap | whose drones | score of | nominal | score | loss | 95 % | Kendall | Spearman |",
    "|---|---|---|---|---|---|---|---|---|",
)


def markdown(report: Mapping[str, Any]) -> str:
    """The table, and above it what it rests on."""
    how = "drawn actions" if report["stochastic"] else "mean actions"
    starts = report["episodes"]
    lines = [
        f"# Robustness of {one_line(report['tournament'])}",
        "",
        f"{report['defenders']} defenders, {report['attackers']} attackers, {starts} fights a pair, {how}. "
        "Score: a win 1, a tie 1/2; loss: nominal less score, positive where the side fares worse. "
        f"Interval: Student's t over the {starts} starts, for these players. Kendall's tau-b and Spearman's rho: "
        "of the side's Bradley-Terry ratings with the nominal ones. The first row is luck alone, "
        "where it was flown.",
        "",
        *HEAD,
        *(_row(row) for row in report["rows"]),
    ]
    if report["left_out"]:
        lines += ["", *(f"- {one_line(line)}" for line in report["left_out"])]
    return "\n".join(lines) + "\n"


def _row(row: Mapping[str, Any]) -> str:
    interval = f"{_number(row['low'], '+')} to {_number(row['high'], '+')}"
    cells = (
        row["about"],
        row["drones"],
        row["role"],
        _number(row["nominal"]),
        _number(row["score"]),
        _number(row["loss"], "+"),
        "-" if row["low"] is None else interval,
        _number(row["kendall"], "+"),
        _number(row["spearman"], "+"),
    )
    return f"| {' | '.join(cells)} |"


def _number(value: float | None, sign: str = "") -> str:
    return "-" if value is None or value != value else f"{value:{sign}.3f}"
