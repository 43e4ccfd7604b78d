"""Figures of who beats whom: the paper's win-rate maps (figures 6, 7), variance maps (8, 9), and
the whole score map.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.ticker import EngFormatter
from numpy.typing import NDArray

from dronecombat_jax.analysis.result import Entrant, score_rate
from dronecombat_jax.analysis.study import Study
from dronecombat_jax.report.figures import ROLE_COLOURS
from dronecombat_jax.report.map_panels import Panel, panel_of, panel_steps
from dronecombat_jax.report.sheet import MISSING, counted, games, name, nothing, own_games, sheet

MOST_TICKS = 7
MOST_NAMED = 20  # entrants: above, the pilots share one name on the axis of the whole map
SCORE_COLOURS = LinearSegmentedColormap.from_list(
    "score", [ROLE_COLOURS["attacker"], "#F6F6F6", ROLE_COLOURS["defender"]]
)


def win_rate_map(study: Study) -> Figure:
    """The share of fights that ten defenders win against all attackers, mean over seeds: the
    paper's figures 6 and 7.
    """
    foot = (
        "Each run's defenders against its own attackers; the mean over seeds of the share of fights that the defender "
        f"wins; ten defenders, evenly spaced. The colours span the values that occur. Grey: no seed played it. {own_games(study.result)}"
    )
    title = "Defender's win rate against its own run's attackers, mean over seeds"
    return _maps(
        study, title, foot, "share of fights won by the defender", "viridis", variance=False
    )


def variance_map(study: Study) -> Figure:
    """The variance of those win rates over seeds: the paper's figures 8 and 9."""
    episodes = study.result.cause.shape[2]
    foot = (
        "As the map of win rates, the variance over seeds (n - 1) of each cell. Chance alone gives up to "
        f"{0.25 / episodes:.2g} with {episodes} fights a cell. Grey: fewer than two seeds. {own_games(study.result)}"
    )
    title = "Variance over seeds of the defender's win rate"
    return _maps(study, title, foot, "variance of the win rate", "magma", variance=True)


def score_map(study: Study) -> Figure:
    """Every defender against every attacker."""
    result = study.result
    grey = "" if result.played.all() else "Grey: not played. "
    foot = (
        "Mean score of the defender: a win 1, a tie 1/2, a loss 0. Entrants of one seed lie together, in order of "
        f"training; lines part the seeds. {grey}{games(result)}"
    )
    rows, columns = _in_order(result.defenders), _in_order(result.attackers)
    tall = min(max(4.5, 0.045 * len(rows) + 2.5), 14.0)
    figure, axes = sheet(
        1,
        1,
        (min(max(8.0, 0.045 * len(columns) + 4.0), 16.0), tall),
        "Everyone against everyone",
        foot,
    )
    ax = axes[0][0]
    image = _image(ax, score_rate(result)[np.ix_(rows, columns)], SCORE_COLOURS, (0.0, 1.0))
    figure.colorbar(image, ax=ax, label="defender's mean score", shrink=0.8)
    for side, order, axis in ((result.defenders, rows, 0), (result.attackers, columns, 1)):
        pilots = "pilots" if len(side) > MOST_NAMED else ""
        groups = [side[index].lineage or pilots or side[index].label for index in order]
        starts = [i for i, group in enumerate(groups) if i == 0 or group != groups[i - 1]]
        middles = (np.asarray(starts) + np.asarray([*starts[1:], len(groups)]) - 1) / 2
        keep = slice(None, None, -(-len(starts) // 30))
        labels = [name(groups[start], 24) for start in starts]
        (ax.set_xticks if axis else ax.set_yticks)(middles[keep], labels[keep], fontsize=8)
        for start in starts[1:]:
            (ax.axvline if axis else ax.axhline)(start - 0.5, color="#333333", linewidth=0.6)
    ax.tick_params(axis="x", rotation=45 if len(columns) > 1 else 0)
    for text in ax.get_xticklabels():
        text.set_horizontalalignment("right" if len(columns) > 1 else "center")
        text.set_rotation_mode("anchor")
    ax.set_xlabel("attacker")
    ax.set_ylabel("defender")
    return figure


def _maps(study: Study, title: str, foot: str, unit: str, colours: str, variance: bool) -> Figure:
    """One panel a method, all in the same colours."""
    figure, axes = sheet(1, max(len(study.methods), 1), (7.0, 4.2), title, foot)
    panels: list[tuple[Axes, Panel]] = []
    for ax, method in zip(axes[0], study.methods, strict=False):
        panel = panel_of(study, method, variance)
        seeds = panel.seeds if panel else 0
        ax.set_title(f"{name(method)} ({counted(seeds, 'seed')})", fontsize=12)
        if panel is None:
            nothing(ax, "no run played its own attackers")
        elif not np.isfinite(panel.values).any():
            nothing(ax, "one seed has no variance")
        else:
            panels.append((ax, panel))
    if not study.methods:
        nothing(axes[0][0], "no trained entrant took part")
    known = (
        np.concatenate([panel.values[np.isfinite(panel.values)] for _, panel in panels])
        if panels
        else np.zeros(1)
    )
    limits = (
        0.0 if variance else _down(known.min()),
        max(float(known.max()), 1e-3) if variance else _up(known.max()),
    )
    image = None
    for ax, panel in panels:
        image = _image(ax, panel.values, colours, limits)
        _label(ax, *panel_steps(study, panel))
    if image is not None:
        figure.colorbar(image, ax=[ax for ax, _ in panels], label=unit, shrink=0.85)
    return figure


def _image(
    ax: Axes, values: NDArray, colours: str | LinearSegmentedColormap, limits: tuple[float, float]
) -> AxesImage:
    """Row 0 at the bottom; what is NaN is left grey."""
    ax.set_facecolor(MISSING)
    shown = np.ma.masked_invalid(values)
    return ax.imshow(
        shown,
        origin="lower",
        aspect="auto",
        cmap=colours,
        vmin=limits[0],
        vmax=limits[1],
        interpolation="none",
    )


def _label(ax: Axes, defenders: Sequence[int], attackers: Sequence[int]) -> None:
    spelt = lambda steps: EngFormatter(sep=" ")(float(f"{steps:.3g}"))
    every = -(-len(attackers) // MOST_TICKS)
    places = np.arange(len(attackers))[::-1][::every][::-1]  # the last one is named
    ax.set_xticks(places, [spelt(attackers[place]) for place in places])
    ax.set_yticks(range(len(defenders)), [spelt(steps) for steps in defenders])
    ax.set_xlabel("attacker: environment steps trained")
    ax.set_ylabel("defender: environment steps trained")


def _in_order(entrants: Sequence[Entrant]) -> list[int]:
    """Indices by method, seed and time; pilots last."""
    key = lambda i: (
        not entrants[i].lineage,
        entrants[i].method,
        entrants[i].lineage,
        entrants[i].chunk,
        entrants[i].label,
    )
    return sorted(range(len(entrants)), key=key)


def _down(value: float) -> float:
    return max(0.0, np.floor(value * 20 + 1e-9) / 20)


def _up(value: float) -> float:
    return min(1.0, np.ceil(value * 20 - 1e-9) / 20) if value > 0 else 0.05
