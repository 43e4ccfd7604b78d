"""Learning curves from the records of `metrics.jsonl`.

Defender blue, attacker orange, as in the scene; colours of Okabe and Ito, safe for the
colour-blind. Thin lines are seeds, thick ones their mean. Reading and writing the records is
`files.metrics`.
"""

import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, LogLocator, MaxNLocator, NullFormatter

from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.files.atomic import cannot_write, write_atomic
from dronecombat_jax.types import SIDES

MOST_POINTS = 200  # of one curve; longer runs are averaged in bins of equal numbers of iterations
ROLE_COLOURS = {"defender": "#0072B2", "attacker": "#D55E00", "tie": "#7F7F7F"}
# From the bottom of the stack: good for the defender, for nobody, for the attacker.
OUTCOMES = {
    "intercept": ("intercepted", "#0072B2"),
    "attacker_crash": ("attacker crashed", "#7CC2EA"),
    "attacker_invalid": ("attacker's action invalid", "#003A5C"),
    "timeout": ("time-out", "#D9D9D9"),
    "both_crash": ("both crashed", "#9C9C9C"),
    "diverged": ("diverged", "#4D4D4D"),
    "both_invalid": ("both actions invalid", "#000000"),
    "defender_invalid": ("defender's action invalid", "#6B2F00"),
    "defender_crash": ("defender crashed", "#F5C36B"),
    "reached": ("target reached", "#D55E00"),
}
# What a sound run never shows is named only where it happened.
FAULTS = ("diverged", "both_invalid", "defender_invalid", "attacker_invalid")
# Logarithmic axes: where the highest value is below so many times the lowest, these of every
# decade.
LOG_TICKS = ((10.0, (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)), (1000.0, (1.0, 2.0, 5.0)))
_SHARE = "share of ended fights"
PANELS = {  # name of the records' keys: heading, what the axis counts, logarithmic
    "win": ("Who wins", _SHARE, False),
    "crash": ("Crashes", _SHARE, False),
    "episode_steps": ("Length of a fight", "control steps", False),
    "return": ("Return of a fight", "sum of rewards", False),
    "explained_variance": ("Explained variance of the value", "1: perfect, 0: none", False),
    "value_loss": ("Value loss", "normalised units", True),
    "kl": ("KL divergence of the last epoch", "nat", True),
    "learning_rate": ("Learning rate", "Adam's step size", True),
    "log_std": ("Exploration", "log standard deviation", False),
    "clip_fraction": ("Clipped probability ratios", "share of the batch", False),
}
# Means over the fights that ended in an iteration; all else is a mean over its steps or updates.
_PER_FIGHT = ("outcome/", "win/", "crash/", "return/", "episode_steps")


class Curves(NamedTuple):
    """The numbers behind a figure: one row per seed, one column per bin of iterations."""

    seeds: list[int]
    steps: np.ndarray  # [K] environment steps per seed at the end of each bin
    values: dict[str, np.ndarray]  # key -> [S, K], NaN where nothing was measured


def learning_curves(records: Sequence[Mapping[str, Any]], path_png: Path, title: str) -> None:
    """Draw the whole training, both roles and all seeds, into `path_png` and a .pdf beside it.

    Raises UserError where there is nothing to draw or a file cannot be written.
    """
    curves = gather(records)
    figure = Figure(figsize=(20.0, 10.5), layout="constrained")
    FigureCanvasAgg(figure)
    names = list(PANELS)
    mosaic: list[Any] = [["outcome", "outcome", *names[:2]], names[2:6], names[6:]]
    axes = figure.subplot_mosaic(mosaic)
    draw_outcomes(axes["outcome"], curves)
    for name, (heading, unit, log) in PANELS.items():
        _draw_lines(axes[name], curves, _lines(name))
        _finish(axes[name], heading, unit, share=unit == _SHARE, log=log)
    axes["episode_steps"].set_ylim(bottom=0.0)
    if axes["explained_variance"].get_ylim()[0] < -1.0:
        axes["explained_variance"].set_ylim(-1.0, 1.05)  # the first updates can be far below
    for ax in axes.values():
        ax.set_xlim(0.0, curves.steps[-1] * (1.1 if len(curves.steps) == 1 else 1.0))
    seeds = "seed" if len(curves.seeds) == 1 else f"{len(curves.seeds)} seeds:"
    listed = ", ".join(map(str, curves.seeds[:10])) + (", ..." if len(curves.seeds) > 10 else "")
    figure.suptitle(f"{title}  ({seeds} {listed})", fontsize=16)
    save_figure(figure, Path(path_png))


def gather(records: Sequence[Mapping[str, Any]]) -> Curves:
    """Records, in any order, as arrays [S, K]; null is NaN, and so is what a seed did not log."""
    if not records:
        raise UserError("metrics: no iteration to draw", EXIT_DATA)
    seeds = sorted({int(record["seed"]) for record in records})
    steps = np.array(sorted({int(record["steps"]) for record in records}))
    row = {seed: index for index, seed in enumerate(seeds)}
    column = {step: index for index, step in enumerate(steps.tolist())}
    keys = ["episodes", *_keys()]
    table = np.full((len(keys), len(seeds), len(steps)), np.nan)
    for record in records:
        at = row[int(record["seed"])], column[int(record["steps"])]
        for index, key in enumerate(keys):
            value = record.get(key)
            if value is not None:
                table[(index, *at)] = float(value)
    size = -(-len(steps) // MOST_POINTS)
    values = {}
    for key, curve in zip(keys, table, strict=True):
        weight = np.nan_to_num(table[0]) if key.startswith(_PER_FIGHT) else np.ones_like(curve)
        values[key] = _bin_means(curve, weight, size)
    ends = np.minimum(np.arange(size, len(steps) + size, size), len(steps)) - 1
    return Curves(seeds, steps[ends], values)


def _keys() -> Iterable[str]:
    yield from (f"outcome/{name}" for name in OUTCOMES)
    for panel in PANELS:
        yield from _lines(panel)


def _lines(panel: str) -> dict[str, str]:
    """The keys of the records that a panel shows, and their labels."""
    if panel == "episode_steps":
        return {panel: "both"}
    if panel == "win":
        return {"win/defender": "defender", "win/draw": "tie", "win/attacker": "attacker"}
    return {f"{panel}/{side}": side for side in SIDES}


def _bin_means(curve: np.ndarray, weight: np.ndarray, size: int) -> np.ndarray:
    """Weighted means of every `size` columns of `curve` [S, I], NaN where no weight is."""
    pad = ((0, 0), (0, -curve.shape[1] % size))
    weight = np.pad(np.where(np.isfinite(curve), weight, 0.0), pad).reshape(len(curve), -1, size)
    filled = np.pad(np.where(np.isfinite(curve), curve, 0.0), pad).reshape(len(curve), -1, size)
    total = weight.sum(axis=-1)
    return np.divide(
        (filled * weight).sum(axis=-1), total, out=np.full(total.shape, np.nan), where=total > 0
    )


def _mean_over_seeds(values: np.ndarray) -> np.ndarray:
    return _bin_means(values.T, np.ones(values.T.shape), values.shape[0])[:, 0]


def draw_outcomes(ax: Axes, curves: Curves, legend: bool = True) -> None:
    """How fights end, stacked; bins in which none ended are bridged."""
    stack = {name: _mean_over_seeds(curves.values[f"outcome/{name}"]) for name in OUTCOMES}
    # older records do not have them all
    stack |= {name: np.nan_to_num(stack[name]) for name in FAULTS}
    stack = {name: share for name, share in stack.items() if name not in FAULTS or share.any()}
    shares = np.array(list(stack.values()))
    known = np.isfinite(shares).all(axis=0)
    steps, shares = curves.steps[known], shares[:, known]
    labels, colours = zip(*(OUTCOMES[name] for name in stack), strict=True)
    if len(steps) == 1:  # a stack of one point has no area
        bottoms = np.cumsum(shares[:, 0]) - shares[:, 0]
        for share, bottom, label, colour in zip(
            shares[:, 0], bottoms, labels, colours, strict=True
        ):
            ax.bar(steps, share, bottom=bottom, width=0.2 * steps[0], color=colour, label=label)
    elif len(steps):
        ax.stackplot(steps, shares, labels=labels, colors=colours, linewidth=0)
    _finish(ax, "How fights end", "share of ended fights", share=True, legend=False)
    if legend and len(steps):
        handles, names = ax.get_legend_handles_labels()
        ax.set_title("How fights end", fontsize=12, pad=24)
        ax.legend(
            handles,
            names,
            ncols=len(names),
            fontsize=9,
            loc="lower center",
            bbox_to_anchor=(0.5, 0.99),
            frameon=False,
            columnspacing=1.0,
            handlelength=1.2,
            handletextpad=0.4,
        )


def _draw_lines(ax: Axes, curves: Curves, lines: Mapping[str, str]) -> None:
    """Each key of `lines` under its label, in the colour of its role."""
    for key, label in lines.items():
        values, colour = curves.values[key], ROLE_COLOURS.get(label, "#333333")
        if not np.isfinite(values).any():
            continue
        marker = "o" if np.isfinite(values).any(axis=0).sum() < 30 else None
        if len(values) > 1:
            for seed in values:
                ax.plot(curves.steps, seed, color=colour, linewidth=0.7, alpha=0.45)
        ax.plot(
            curves.steps,
            _mean_over_seeds(values),
            color=colour,
            linewidth=2.0,
            label=label,
            marker=marker,
            markersize=3.5,
        )


def _finish(
    ax: Axes,
    heading: str,
    unit: str,
    *,
    share: bool = False,
    log: bool = False,
    legend: bool = True,
) -> None:
    drawn = ax.has_data()
    ax.set_title(heading, fontsize=12)
    ax.set_xlabel("environment steps per seed")
    ax.set_ylabel(unit)
    ax.grid(alpha=0.25)
    ax.xaxis.set_major_formatter(EngFormatter(sep=" "))
    ax.xaxis.set_major_locator(MaxNLocator(6))
    if share:
        ax.set_ylim(-0.02 if legend else 0.0, 1.02 if legend else 1.0)
    if log and any(np.any(np.asarray(line.get_ydata(), float) > 0) for line in ax.get_lines()):
        ax.set_yscale("log")
        low, high = ax.get_ylim()
        subs = next((subs for span, subs in LOG_TICKS if high < span * low), (1.0,))
        ax.yaxis.set_major_locator(LogLocator(subs=subs))
        ax.yaxis.set_major_formatter("{x:g}")
        # its labels, shown or not, would push the axis label away
        ax.yaxis.set_minor_formatter(NullFormatter())
    if legend and len(ax.get_legend_handles_labels()[0]) > 1:
        ax.legend(fontsize=9, framealpha=0.85)
    if not drawn:
        ax.text(
            0.5,
            0.5,
            "nothing measured",
            transform=ax.transAxes,
            ha="center",
            va="center",
            color="#777777",
        )


def save_figure(figure: Figure, path: Path) -> None:
    """Write the PNG and a PDF beside it, each whole or not at all."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(path, error) from None
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # laid out: not once more for every file
    for target in (path, path.with_suffix(".pdf")):
        content = io.BytesIO()
        figure.savefig(content, dpi=100, format=target.suffix[1:])
        write_atomic(target, content.getvalue())
