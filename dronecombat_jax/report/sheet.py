"""The paper on which a tournament's figures are drawn: size, footers, names, axes of training time."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator
from numpy.typing import NDArray

from dronecombat_jax.analysis.gaps import seeds_of
from dronecombat_jax.analysis.result import Entrant, TournamentResult, by_training, showings
from dronecombat_jax.config.schema import one_line

# Of Okabe and Ito, without the blue and orange of the roles.
METHOD_COLOURS = ("#009E73", "#CC79A7", "#E69F00", "#000000", "#56B4E9", "#9A8700")
MISSING = "#BDBDBD"  # a cell that was not played; no map has this grey
GAUGE = "Gauge: the mean over all entrants of both roles is 1500"


class Timeline(NamedTuple):
    """One number along the training of S seeds of one method."""

    lineages: tuple[str, ...]  # [S]
    steps: NDArray[np.integer]  # [T] environment steps trained, rising
    values: NDArray[np.float64]  # [S, T] NaN where that seed has no entrant


def sheet(
    rows: int, columns: int, size: tuple[float, float], title: str, foot: str, **subplots
) -> tuple[Figure, list[list[Axes]]]:
    """A figure of `size` inches a panel, with a title and a footer, and its axes [rows][columns]."""
    width = max(columns * size[0], 7.0)
    figure = Figure(figsize=(width, rows * size[1] + 1.2), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle("\n".join(textwrap.wrap(title, int(width * 8))), fontsize=14)
    figure.supxlabel(
        "\n".join(textwrap.wrap(foot, int(width * 15.5))), fontsize=8.5, color="#444444"
    )
    axes = figure.subplots(rows, columns, squeeze=False, **subplots)
    return figure, [list(row) for row in axes]


def games(result: TournamentResult) -> str:
    """How many fights a figure of the whole tournament rests on, and of how many seeds; for its
    footer.
    """
    episodes, played = result.cause.shape[2], int(result.played.sum())
    absent = result.played.size - played
    shape = f"{result.played.shape[0]} defenders x {result.played.shape[1]} attackers x {episodes} fights a cell"
    gaps = f", {absent} cells not played" if absent else ""
    return f"{played * episodes:,} fights ({shape}{gaps}). {_seeds(result)}"


def own_games(result: TournamentResult, most: int | None = None) -> str:
    """The same for a figure of each run by itself, of at most so many fights a cell."""
    episodes = min(most or result.cause.shape[2], result.cause.shape[2])
    own = own_cells(result)
    absent = int(np.sum(own & ~result.played))
    gaps = f", {absent} cells not played" if absent else ""
    cells = int(np.sum(own & result.played))
    return f"{cells * episodes:,} fights ({cells:,} cells of all runs x {episodes}{gaps}). {_seeds(result)}"


def own_cells(result: TournamentResult) -> NDArray[np.bool_]:
    """The cells [D, A] between players of one training."""
    trainings = [by_training(side) for side in (result.defenders, result.attackers)]
    own = np.zeros(result.played.shape, bool)
    for lineage in trainings[0]:
        own[np.ix_(*([index for index, _ in side.get(lineage, ())] for side in trainings))] = True
    return own


def _seeds(result: TournamentResult) -> str:
    counts = ", ".join(f"{name(method)} {count}" for method, count in seeds_of(result).items())
    return f"Training seeds: {counts or 'none'}."


def name(text: str, most: int = 32) -> str:
    """A name as a figure can show it: one line, not too long, no dollar that would begin a formula."""
    text = one_line(text)
    return (text if len(text) <= most else text[: most - 3] + "...").replace("$", r"\$")


def timelines_of(
    entrants: Sequence[Entrant], values: NDArray | Mapping[str, NDArray], methods: Sequence[str]
) -> dict[str, Timeline]:
    """`values` [N] of one side's entrants, or those by lineage, by method, seed and steps trained.

    An entrant that was saved again and again has its value at each of these times.
    """
    lines: dict[str, Timeline] = {}
    for method in methods:
        mine = [
            (entrant.lineage, entrant.steps, i)
            for i, entrant in showings(entrants)
            if entrant.lineage and entrant.method == method
        ]
        lineages, steps = sorted({key[0] for key in mine}), sorted({key[1] for key in mine})
        table = np.full((len(lineages), len(steps)), np.nan)
        for lineage, step, index in mine:
            own = values.get(lineage) if isinstance(values, Mapping) else values
            table[lineages.index(lineage), steps.index(step)] = (
                np.nan if own is None else own[index]
            )
        lines[method] = Timeline(tuple(lineages), np.asarray(steps, int), table)
    return lines


def mean_and_spread(values: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Mean, standard deviation (ddof 1, NaN for fewer than two) and number of the finite ones in
    each column.
    """
    known = np.isfinite(values)
    count = known.sum(axis=0)
    mean = np.where(known, values, 0.0).sum(axis=0) / np.where(count > 0, count, np.nan)
    squares = np.where(known, (values - mean) ** 2, 0.0).sum(axis=0)
    return mean, np.sqrt(squares / np.where(count > 1, count - 1, np.nan)), count


def common(values: NDArray) -> NDArray[np.bool_]:
    """The columns of `values` [S, T] that every seed with values has: elsewhere a mean would jump
    from seed to seed.
    """
    known = np.isfinite(values)
    return known.sum(axis=0) == max(int(known.any(axis=1).sum()), 1)


def time_axis(ax: Axes, label: str = "environment steps trained") -> None:
    """The x axis counts environment steps."""
    ax.set_xlabel(label)
    ax.xaxis.set_major_formatter(EngFormatter(sep=" "))
    ax.xaxis.set_major_locator(MaxNLocator(6))
    ax.grid(alpha=0.25)


def counted(number: int, thing: str) -> str:
    """A count with its noun, such as "1 seed" and "2 seeds"."""
    return f"{number} {thing}{'s' * (number != 1)}"


def nothing(ax: Axes, reason: str) -> None:
    """Say in the panel why it is empty."""
    ax.text(
        0.5,
        0.5,
        textwrap.fill(reason, 40),
        transform=ax.transAxes,
        ha="center",
        va="center",
        color="#777777",
    )
    ax.set_xticks([])
    ax.set_yticks([])


def colours(methods: Sequence[str]) -> Mapping[str, str]:
    """A colour for each method."""
    return {method: METHOD_COLOURS[i % len(METHOD_COLOURS)] for i, method in enumerate(methods)}
