"""The figure of how the checkpoints of each run fly."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dronecombat_jax.files.plain import Table, plain_value
from dronecombat_jax.report.figures import ROLE_COLOURS
from dronecombat_jax.report.sheet import common, mean_and_spread, name, sheet, time_axis
from dronecombat_jax.tournaments.flights import Flown
from dronecombat_jax.types import SIDES

STYLES = ("-", "--", ":", "-.")  # of the methods
PANELS = {  # field of `Flown`: heading, unit
    "time": ("Length of a fight", "s"),
    "closing_speed": ("Closing speed at the end", "m/s"),
    "approach_angle": (
        "Angle between the velocities at the end",
        "degrees; 0: a tail chase, 180: head on",
    ),
    "altitude": ("Mean altitude", "m"),
    "path_ratio": ("Length of the path over the straight line", "1: straight"),
    "control_effort": ("Control effort", "mean of |u|², u in [-1, 1]⁴"),
}


def flight_over_time(flown: Sequence[Flown]) -> Figure:
    """Six quantities over training; each run's two sides of one chunk against each other."""
    methods = list(dict.fromkeys(flight.method for flight in flown))
    seeds = {
        method: len({flight.run for flight in flown if flight.method == method})
        for method in methods
    }
    fights = sum(flight.fights for flight in flown)
    foot = (
        "Each run's defender against its own attacker of the same chunk. Mean over the recorded fights, then over seeds, "
        "at chunks that all seeds have; band: one standard deviation over seeds. Black: of both sides together. "
        f"{fights:,} recorded fights ({flown[0].fights} of each pair). Training seeds: "
        f"{', '.join(f'{name(method)} {count}' for method, count in seeds.items())}."
    )
    figure, axes = sheet(2, 3, (5.0, 3.5), "How they fly, over training", foot)
    for ax, (field, (heading, unit)) in zip([*axes[0], *axes[1]], PANELS.items(), strict=True):
        for method, style in zip(methods, STYLES * len(methods), strict=False):
            mine = [flight for flight in flown if flight.method == method]
            for label, values in _lines(mine, field):
                _draw(ax, mine, values, style, label, f"{name(method)}: {label}")
        ax.set_title(heading, fontsize=11)
        ax.set_ylabel(unit)
        time_axis(ax)
    axes[0][0].legend(fontsize=8, framealpha=0.85, handlelength=4.0)
    axes[1][0].legend(fontsize=8, framealpha=0.85, handlelength=4.0)
    return figure


def flight_table(flown: Sequence[Flown]) -> Table:
    """All rows, one number a column."""
    columns = [field for field in Flown._fields if not isinstance(getattr(flown[0], field), tuple)]
    pairs = [field for field in Flown._fields if field not in columns]
    rows = tuple(
        (
            *(plain_value(getattr(flight, field)) for field in columns),
            *(getattr(flight, field)[role] for field in pairs for role in range(len(SIDES))),
        )
        for flight in flown
    )
    about = (
        "Each run's defender against its own attacker of the same chunk; means over the recorded fights. Time in s, speed in "
        "m/s, angle in rad, altitudes in m."
    )
    named = (*columns, *(f"{role}_{field}" for field in pairs for role in SIDES))
    return Table("flights", about, named, rows)


def _lines(flown: Sequence[Flown], field: str) -> list[tuple[str, list[float]]]:
    """Label and values of each line of a panel."""
    values = [getattr(flight, field) for flight in flown]
    if isinstance(values[0], tuple):
        return [(role, [value[i] for value in values]) for i, role in enumerate(SIDES)]
    scale = 180.0 / np.pi if field == "approach_angle" else 1.0
    return [("both", [scale * value for value in values])]


def _draw(
    ax: Axes, flown: Sequence[Flown], values: Sequence[float], style: str, label: str, legend: str
) -> None:
    steps, table = _by_seed(flown, values)
    whole = common(table)
    mean, spread, _ = mean_and_spread(table[:, whole])
    colour = ROLE_COLOURS.get(label, "#222222")
    ax.fill_between(
        steps[whole], mean - spread, mean + spread, color=colour, alpha=0.13, linewidth=0
    )
    marker = "o" if whole.sum() < 30 else None
    ax.plot(
        steps[whole],
        mean,
        style,
        color=colour,
        linewidth=1.8,
        marker=marker,
        markersize=3,
        label=legend,
    )


def _by_seed(flown: Sequence[Flown], values: Sequence[float]) -> tuple[NDArray, NDArray]:
    """Steps [T] and the values [S, T]; NaN where a seed has none."""
    runs, steps = (
        sorted({flight.run for flight in flown}),
        sorted({flight.steps for flight in flown}),
    )
    table = np.full((len(runs), len(steps)), np.nan)
    for flight, value in zip(flown, values, strict=True):
        table[runs.index(flight.run), steps.index(flight.steps)] = value
    return np.asarray(steps), table
