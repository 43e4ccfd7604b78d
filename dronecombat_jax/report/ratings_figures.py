"""Figures of strength: Elo against training time (the paper's figures 4 and 5), order-free ratings
beside Elo.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dronecombat_jax.analysis.bradley_terry import PRIOR_SD
from dronecombat_jax.analysis.elo import K_FACTOR
from dronecombat_jax.analysis.result import Entrant, by_training
from dronecombat_jax.analysis.study import ELO_EPISODES, Study, own_elo_by_side
from dronecombat_jax.report.figures import ROLE_COLOURS
from dronecombat_jax.report.sheet import (
    GAUGE,
    common,
    counted,
    games,
    mean_and_spread,
    name,
    nothing,
    own_games,
    sheet,
    time_axis,
    timelines_of,
)
from dronecombat_jax.types import SIDES

NO_TRAINING = "no trained entrant took part"
MOST_ROWS = 40  # of the final policies


def elo_over_time(study: Study) -> Figure:
    """Elo of both roles against training time, each run rated by itself: the paper's figures 4 and
    5.
    """
    result, episodes = study.result, min(ELO_EPISODES, study.result.cause.shape[2])
    foot = (
        f"Every run is rated in its own tournament, its defenders against its attackers, by the first {episodes} fights "
        f"a cell (eq. 3, 4: start 1500, K {K_FACTOR:g}, mean over {study.elo.orders} random orders). {GAUGE}, in each "
        "run. Thick: mean over seeds, at checkpoints of all; band: one standard deviation over seeds; thin: seeds. "
        f"{own_games(result, ELO_EPISODES)}"
    )
    figure, axes = sheet(
        1,
        max(len(study.methods), 1),
        (6.4, 4.4),
        "Elo of both roles over training",
        foot,
        sharey=True,
    )
    for ax, method in zip(axes[0], study.methods, strict=False):
        most = 0
        for role, entrants, values in own_elo_by_side(study):
            line = timelines_of(entrants, values, [method])[method]
            mean, spread, _ = mean_and_spread(line.values)
            most = max(most, int(np.isfinite(line.values).any(axis=1).sum()))
            colour = ROLE_COLOURS[role]
            for seed in line.values:
                known = np.isfinite(seed)
                ax.plot(line.steps[known], seed[known], color=colour, linewidth=0.7, alpha=0.45)
            all_of_them = common(line.values)
            steps, mean, spread = line.steps[all_of_them], mean[all_of_them], spread[all_of_them]
            ax.fill_between(
                steps, mean - spread, mean + spread, color=colour, alpha=0.18, linewidth=0
            )
            ax.plot(
                steps,
                mean,
                color=colour,
                linewidth=2.2,
                label=role,
                marker=_marker(steps),
                markersize=4,
            )
        ax.set_title(f"{name(method)} ({counted(most, 'seed')})", fontsize=12)
        time_axis(ax)
        if not most:
            nothing(ax, "no run played its own attackers")
    axes[0][0].set_ylabel("Elo points")
    if study.methods:
        _legend(axes[0][0])
    else:
        nothing(axes[0][0], NO_TRAINING)
    return figure


def ratings_over_time(study: Study) -> Figure:
    """Order-free ratings with intervals beside Elo with its spread over orders, of the whole
    tournament.
    """
    columns = {
        "Bradley-Terry, 95 % interval": study.scale,
        "Elo, spread over orders": study.elo_scale,
    }
    walk = ""
    if study.smooth is not None and study.smooth_scale is not None:
        columns["smoothed Bradley-Terry, 95 % interval"] = study.smooth_scale
        walk = f"Smoothed: a random walk of {study.smooth.width:.0f} points a chunk along each seed's training. "
    foot = (
        f"All entrants in one tournament. {GAUGE}, in all panels. One line a seed; a band up to the frame has no end. "
        f"Bradley-Terry counts a tie as half a win and takes fights as independent; prior: standard deviation "
        f"{PRIOR_SD:g} points. Elo: K {K_FACTOR:g}, mean and standard deviation over "
        f"{study.elo.orders} orders of the first {min(ELO_EPISODES, study.result.cause.shape[2])} fights a cell, a "
        f"spread that more fights do not narrow. {walk}{games(study.result)}"
    )
    rows = max(len(study.methods), 1)
    title = "Ratings in the whole tournament"
    figure, axes = sheet(rows, len(columns), (5.2, 3.8), title, foot, sharey=True, sharex="row")
    for row, method in zip(axes, study.methods, strict=False):
        for ax, (heading, scale) in zip(row, columns.items(), strict=True):
            sides = zip(*(_sides(study, values) for values in scale), strict=True)
            for three in sides:
                bands = [timelines_of(side, values, [method])[method] for _, side, values in three]
                for rating, low, high in zip(*(band.values for band in bands), strict=True):
                    _band(ax, bands[0].steps, rating, low, high, three[0][0])
            ax.set_title(f"{name(method)}: {heading}", fontsize=10.5)
            time_axis(ax)
        row[0].set_ylabel("Elo points")
    trained = np.asarray([bool(entrant.lineage) for entrant in study.entrants], bool)
    axes[0][0].set_ylim(
        *_limits(np.concatenate([values[trained] for values in (*study.scale, *study.elo_scale)]))
    )
    _legend(axes[0][0]) if study.methods else [nothing(ax, NO_TRAINING) for ax in axes[0]]
    return figure


def finals(study: Study) -> Figure:
    """The last policy of every seed, and the scripted pilots: rating with its interval beside Elo."""
    foot = (
        f"Filled: Bradley-Terry with its 95 % interval (an arrow: no end, since nothing bounds the rating). "
        f"Open: Elo with one standard deviation over {study.elo.orders} orders. {GAUGE}. {games(study.result)}"
    )
    rated, elo = study.scale, study.elo_scale
    cut = len(study.result.defenders)
    parts = ((0, study.entrants[:cut]), (cut, study.entrants[cut:]))
    chosen = [{start + item: label for item, label in _last(side).items()} for start, side in parts]
    everyone = np.asarray([*chosen[0], *chosen[1]], int)
    limits = _limits(np.concatenate([values[everyone] for values in (*rated, *elo)]))
    size = (7.0, 1.6 + 0.3 * min(max(map(len, chosen)), MOST_ROWS))
    figure, axes = sheet(1, 2, size, "Final policies and scripted pilots", foot, sharex=True)
    for ax, role, members in zip(axes[0], SIDES, chosen, strict=True):
        order = sorted(members, key=lambda index: np.nan_to_num(rated.rating[index], nan=-np.inf))[
            -MOST_ROWS:
        ]
        ax.set_xlim(*limits)
        for row, index in enumerate(order):
            if np.isnan(rated.rating[index]):
                ax.text(
                    float(np.mean(limits)),
                    row,
                    "no fights",
                    ha="center",
                    va="center",
                    color="#777777",
                    fontsize=8.5,
                )
                continue
            _interval(
                ax, row + 0.12, rated.low[index], rated.high[index], limits, ROLE_COLOURS[role]
            )
            ax.plot(rated.rating[index], row + 0.12, "o", color=ROLE_COLOURS[role], markersize=5)
            ax.hlines(row - 0.2, elo.low[index], elo.high[index], color="#777777", linewidth=1.4)
            ax.plot(
                elo.rating[index],
                row - 0.2,
                "s",
                color="#777777",
                markerfacecolor="white",
                markersize=4,
            )
        ax.set_yticks(
            range(len(order)), [name(members[index], 36) for index in order], fontsize=8.5
        )
        ax.set_ylim(-0.7, len(order) - 0.3)
        cut_off = f" (the best {MOST_ROWS} of {len(members)})" if len(members) > len(order) else ""
        ax.set_title(f"{role}s{cut_off}", fontsize=12)
        ax.set_xlabel("Elo points")
        ax.grid(alpha=0.25)
    return figure


def _sides(study: Study, values: NDArray) -> list[tuple]:
    """(role, entrants, values) of both sides, of `values` [P]."""
    cut = len(study.result.defenders)
    return [
        (SIDES[0], study.result.defenders, values[:cut]),
        (SIDES[1], study.result.attackers, values[cut:]),
    ]


def _last(entrants: Sequence[Entrant]) -> dict[int, str]:
    """The indices of each seed's last entrant and of the pilots, with their names."""
    trained = {saved[-1][0]: saved[-1][1].label for saved in by_training(entrants).values()}
    return trained | {
        index: entrant.label for index, entrant in enumerate(entrants) if not entrant.lineage
    }


def _band(
    ax: Axes, steps: NDArray, rating: NDArray, low: NDArray, high: NDArray, role: str
) -> None:
    known = np.isfinite(rating)
    if not known.any():
        return
    steps, colour = steps[known], ROLE_COLOURS[role]
    low, high = np.maximum(low[known], -1e5), np.minimum(high[known], 1e5)
    ax.plot(
        steps,
        rating[known],
        color=colour,
        linewidth=1.2,
        label=role,
        marker=_marker(steps),
        markersize=3,
    )
    if len(steps) == 1:
        ax.vlines(steps, low, high, color=colour, linewidth=1.0, alpha=0.6)
    ax.fill_between(steps, low, high, color=colour, alpha=0.16, linewidth=0)


def _interval(
    ax: Axes, y: float, low: float, high: float, limits: tuple[float, float], colour: str
) -> None:
    """A line from `low` to `high`, with an arrow where it has no end."""
    ax.hlines(y, max(low, limits[0]), min(high, limits[1]), color=colour, linewidth=1.6)
    for end, limit, marker in ((low, limits[0], "<"), (high, limits[1], ">")):
        if np.isinf(end):
            ax.plot(limit, y, marker, color=colour, markersize=6, clip_on=False)


def _limits(values: NDArray) -> tuple[float, float]:
    """The range of the finite `values` with a margin."""
    known = values[np.isfinite(values)]
    low, high = (known.min(), known.max()) if len(known) else (1500.0, 1500.0)
    room = max(0.06 * (high - low), 20.0)
    return float(low - room), float(high + room)


def _marker(steps: NDArray) -> str | None:
    return "o" if len(steps) < 30 else None


def _legend(ax: Axes) -> None:
    by_name = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    if by_name:
        ax.legend(by_name.values(), by_name.keys(), fontsize=9, framealpha=0.85)
