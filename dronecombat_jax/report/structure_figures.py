"""Figures of what ratings hide: forgetting, and how fights end over training."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dronecombat_jax.analysis.forgetting import Forgetting
from dronecombat_jax.analysis.study import Memory, Study
from dronecombat_jax.report.figures import OUTCOMES, Curves, draw_outcomes
from dronecombat_jax.report.sheet import (
    colours,
    common,
    counted,
    games,
    mean_and_spread,
    name,
    nothing,
    own_games,
    sheet,
    timelines_of,
)
from dronecombat_jax.types import SIDES, Cause

NO_MAP = "no run played its own attackers"
SUMMARIES = {  # heading: of one run's memory
    "backward transfer\n(final minus then,\nown past)": lambda memory: (
        memory.defender.backward_transfer
    ),
    "worst case against\nthe own past,\nminus 1/2": lambda memory: (
        memory.defender.final_worst - 0.5
    ),
    "home minus away\n(own attackers\nminus others')": lambda memory: memory.home - memory.away,
}


def forgetting_profile(study: Study) -> Figure:
    """Scores against opponents of the past and the future, and what the final policies lost."""
    foot = (
        "Score: a win 1, a tie 1/2. Lag: checkpoints of the tournament between learner and opponent, which are of the "
        "same run; above 0 the opponent is older. Line: mean over seeds; band: one standard deviation over seeds. "
        f"Right: the final defender of each seed, bar: mean over seeds. {own_games(study.result)}"
    )
    figure, axes = sheet(1, 3, (5.4, 4.4), "Forgetting: each run against its own past", foot)
    colour = colours(study.methods)
    for ax, role in zip(axes[0], SIDES, strict=False):
        for method in study.methods:
            profiles = [getattr(memory, role) for memory in _memories(study, method)]
            _profile(ax, profiles, colour[method], f"{name(method)} ({len(profiles)})")
        ax.axhline(0.5, color="#777777", linewidth=0.8, linestyle=":")
        ax.axvline(0.0, color="#777777", linewidth=0.8, linestyle=":")
        ax.set_title(f"{role}s", fontsize=12)
        ax.set_xlabel("lag: opponent newer  <  0  <  opponent older  [checkpoints]")
        ax.set_ylabel(f"{role}'s mean score")
        ax.grid(alpha=0.25)
        if not study.memory:
            nothing(ax, NO_MAP)
    if study.memory:
        axes[0][0].legend(fontsize=9, framealpha=0.85, title="method (seeds)")
        _summary(axes[0][2], study)
    else:
        nothing(axes[0][2], NO_MAP)
    return figure


def outcomes_over_time(study: Study) -> Figure:
    """How the fights of each checkpoint end, over all its opponents."""
    foot = (
        "Mean over seeds, at checkpoints of all, of the shares of all fights of a checkpoint, over all its opponents in the "
        f"tournament. {games(study.result)}"
    )
    rows = max(len(study.methods), 1)
    figure, axes = sheet(
        rows, 2, (6.6, 3.6), "How fights end, by training of one side", foot, sharey=True
    )
    handles: dict = {}
    for row, method in zip(axes, study.methods, strict=False):
        for ax, role, endings in zip(row, SIDES, study.endings, strict=True):
            side = (study.result.defenders, study.result.attackers)[SIDES.index(role)]
            lines = {
                cause: timelines_of(side, endings.share[:, cause], [method])[method]
                for cause in Cause
                if cause
            }
            intercepted = lines[Cause.INTERCEPT]
            kept = common(intercepted.values)
            if not np.isfinite(intercepted.values).any() or not kept.any():
                nothing(
                    ax,
                    f"no {role} of this method fought, or its seeds have no checkpoint in common",
                )
            else:
                values = {
                    f"outcome/{cause.name.lower()}": line.values[:, kept]
                    for cause, line in lines.items()
                }
                steps = intercepted.steps[kept]
                draw_outcomes(
                    ax, Curves(list(range(len(intercepted.lineages))), steps, values), legend=False
                )
                if len(steps) > 1:
                    ax.set_xlim(steps[0], steps[-1])
                handles |= dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
            seeds = int(np.isfinite(intercepted.values).any(axis=1).sum())
            ax.set_title(f"{name(method)}: {role}s of {counted(seeds, 'seed')}", fontsize=11)
            ax.set_xlabel(f"environment steps that the {role} trained")
    if not study.methods:
        for ax in axes[0]:
            nothing(ax, "no trained entrant took part")
    if handles:
        order = [label for label, _ in OUTCOMES.values() if label in handles]
        figure.legend(
            [handles[intercepted] for intercepted in order],
            order,
            loc="outside right upper",
            fontsize=9,
            frameon=False,
        )
    return figure


def _memories(study: Study, method: str) -> list[Memory]:
    runs = [win_map.run for win_map in study.win_maps[method]]
    return [study.memory[run] for run in runs if run in study.memory]


def _profile(ax: Axes, memories: list[Forgetting], colour: str, label: str) -> None:
    if not memories:
        return
    reach = max(len(memory.profile) // 2 for memory in memories)
    table = np.full((len(memories), 2 * reach + 1), np.nan)
    for row, memory in zip(table, memories, strict=True):
        own = len(memory.profile) // 2
        row[reach - own : reach + own + 1] = memory.profile
    mean, spread, _ = mean_and_spread(table)
    lag, known = np.arange(-reach, reach + 1), np.isfinite(mean)
    ends = np.clip([mean - spread, mean + spread], 0.0, 1.0)  # no score lies beyond
    ax.fill_between(lag, *ends, color=colour, alpha=0.18, linewidth=0)
    ax.plot(
        lag[known],
        mean[known],
        color=colour,
        linewidth=2.0,
        label=label,
        marker="o" if known.sum() < 30 else None,
        markersize=3,
    )


def _summary(ax: Axes, study: Study) -> None:
    colour = colours(study.methods)
    width = 0.7 / len(study.methods)
    for place, measure in enumerate(SUMMARIES.values()):
        for number, method in enumerate(study.methods):
            x = place + (number - (len(study.methods) - 1) / 2) * width
            values = np.asarray([measure(memory) for memory in _memories(study, method)])
            values = values[np.isfinite(values)]
            ax.plot(
                x + np.linspace(-0.2, 0.2, len(values)) * width,
                values,
                "o",
                color=colour[method],
                markersize=4,
                alpha=0.7,
            )
            if len(values):
                ax.hlines(
                    values.mean(),
                    x - 0.35 * width,
                    x + 0.35 * width,
                    color=colour[method],
                    linewidth=2.5,
                )
    ax.axhline(0.0, color="#777777", linewidth=0.8, linestyle=":")
    ax.set_xticks(range(len(SUMMARIES)), list(SUMMARIES), fontsize=9)
    ax.set_xlim(-0.6, len(SUMMARIES) - 0.4)
    ax.set_ylabel("difference of mean scores")
    ax.set_title("final defenders", fontsize=12)
    ax.grid(alpha=0.25, axis="y")
