"""The figure of a tournament's robustness: loss of score and of ranks under each gap."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dronecombat_jax.report.figures import ROLE_COLOURS
from dronecombat_jax.report.sheet import name, nothing, sheet
from dronecombat_jax.types import SIDES

SHIFT = 0.17  # of the two sides' rows, up and down


def robustness_figure(report: Mapping[str, Any]) -> Figure:
    """Left: the loss of each side with its interval. Right: the rank correlation of its ratings."""
    starts = report["episodes"]
    foot = (
        f"{report['defenders']} defenders, {report['attackers']} attackers, {starts} fights a pair. A side's score: a win 1, "
        f"a tie 1/2; loss: without the gap less under it, with the 95 % interval over the {starts} starts. Filled: this "
        "side's drones alone differ; open: both sides' do. Right: Kendall's tau-b of the side's "
        "Bradley-Terry ratings with those without the gap."
    )
    rows = report["rows"]
    gaps = list(dict.fromkeys(row["about"] for row in rows))
    title = f"Robustness of {name(report['tournament'])}"
    size = (5.2, max(2.4, 0.42 * len(gaps) + 0.8))
    figure, ((left, right),) = sheet(1, 2, size, title, foot, sharey=True)
    if not rows:
        nothing(left, "no gap was flown")
        nothing(right, "no gap was flown")
        return figure
    for role, side in enumerate(SIDES):
        mine = [row for row in rows if row["role"] == side]
        places = [gaps.index(row["about"]) + SHIFT * (2 * role - 1) for row in mine]
        _losses(left, mine, places, side)
        _ranks(right, mine, places, side)
    left.set_yticks(range(len(gaps)), [gap.replace("$", r"\$") for gap in gaps])
    left.set_ylim(len(gaps) - 0.5, -0.5)
    left.set_xlabel("loss of score")
    above = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "ncol": 2, "frameon": False}
    left.legend(fontsize=9, **above)
    right.set_xlabel("rank correlation with the nominal ratings")
    right.set_xlim(-1.05, 1.05)
    for ax in (left, right):
        ax.grid(axis="x", alpha=0.3)
        ax.tick_params(axis="y", length=0)
        for line in range(1, len(gaps)):
            ax.axhline(line - 0.5, color="#DDDDDD", linewidth=0.7)
    return figure


def _losses(ax: Axes, rows: Sequence[Mapping[str, Any]], places: list[float], side: str) -> None:
    colour = ROLE_COLOURS[side]
    ax.axvline(0.0, color="#888888", linewidth=0.8)
    for row, place in zip(rows, places, strict=True):
        if row["low"] is not None:
            ax.plot([row["low"], row["high"]], [place, place], color=colour, linewidth=1.6)
        fill = "white" if row["drones"] == "both" else colour
        ax.plot(row["loss"], place, "o", color=colour, markerfacecolor=fill, markersize=6)
    ax.plot([], [], "o-", color=colour, label=f"{side}s")


def _ranks(ax: Axes, rows: Sequence[Mapping[str, Any]], places: list[float], side: str) -> None:
    known = np.asarray([row["kendall"] is not None for row in rows], bool)
    if not known.any():
        few = f"{side}s: fewer than three, or all alike"
        ax.text(0.03, 0.97 - 0.07 * SIDES.index(side), few, transform=ax.transAxes, va="top")
    for row, place in zip(rows, places, strict=True):
        if row["kendall"] is not None:
            fill = "white" if row["drones"] == "both" else ROLE_COLOURS[side]
            ax.plot(row["kendall"], place, "o", color=ROLE_COLOURS[side], markerfacecolor=fill)
