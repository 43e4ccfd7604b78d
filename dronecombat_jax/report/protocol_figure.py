"""What the paper's protocol, two pools rated apart, can make of the same runs: one figure."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dronecombat_jax.analysis.claims import IPPO, PAPER_GAP, SIPPO
from dronecombat_jax.analysis.protocol import PLANTED_EPISODES, Protocol
from dronecombat_jax.report.sheet import METHOD_COLOURS, counted, nothing, sheet

PAPER_COLOUR = "#555555"
OURS_COLOUR = "#D55E00"
BINS = 40


def protocol_figure(protocol: Protocol) -> Figure:
    """By chance alone, by weaker attackers alone, and by whose attackers there are."""
    seeds = [len(protocol.own[method]) for method in (SIPPO, IPPO)]
    foot = (
        "Final defender's Elo (eq. 3, 4; the mean of a pool is 1500), S-IPPO minus IPPO. Left: each run rated with its own "
        f"attackers, {seeds[0]} v {seeds[1]} seeds; the difference under all relabellings of the seeds. Middle: planted; fights "
        f"drawn from the strengths fitted to IPPO's pools, {PLANTED_EPISODES} a cell, with all attackers weaker by so much and "
        "nothing else changed. Right: each final defender rated with every other run's attackers in turn, less "
        "its mean over them; a dot is a defender."
    )
    title = "What rating two methods in pools of their own can show by itself"
    figure, axes = sheet(1, 3, (5.0, 4.0), title, foot)
    _by_chance(axes[0][0], protocol)
    _by_weaker_attackers(axes[0][1], protocol)
    _by_whose_attackers(axes[0][2], protocol)
    return figure


def _by_chance(ax: Axes, protocol: Protocol) -> None:
    values = protocol.by_chance
    reach = max(float(np.abs(values).max()), PAPER_GAP * 1.1)
    ax.hist(values, bins=np.linspace(-reach, reach, BINS + 1).tolist(), color="#BBBBBB")
    ax.set_ylim(0, 1.3 * ax.get_ylim()[1])  # room for the legend
    ax.axvline(PAPER_GAP, color=PAPER_COLOUR, linestyle="--", label=f"paper: {PAPER_GAP:+.0f}")
    label = f"ours: {protocol.difference:+.0f} (p = {protocol.p_value:.2g})"
    ax.axvline(protocol.difference, color=OURS_COLOUR, label=label)
    low, high = np.quantile(values, [0.025, 0.975])
    ax.set_title(f"By chance: 95 % within {low:+.0f} to {high:+.0f}", fontsize=11)
    ax.set_xlabel("difference, Elo points")
    ax.set_ylabel(counted(len(values), "relabelling"))
    ax.legend(fontsize=8.5)


def _by_weaker_attackers(ax: Axes, protocol: Protocol) -> None:
    ax.set_title("By weaker attackers alone (planted)", fontsize=11)
    if not len(protocol.lifted):
        return nothing(ax, "no run met all of its own attackers")
    weaker, colour = protocol.weaker, METHOD_COLOURS[0]
    for seed in protocol.lifted:
        ax.plot(weaker, seed, color=colour, linewidth=0.7, alpha=0.5)
    ax.plot(
        weaker, protocol.lifted.mean(axis=0), color=colour, linewidth=2.2, label="mean of seeds"
    )
    ax.plot(weaker, weaker / 2, color="#000000", linestyle=":", label="half of it: the gauge")
    ax.axhline(PAPER_GAP, color=PAPER_COLOUR, linestyle="--", label=f"paper: {PAPER_GAP:+.0f}")
    ax.set_xlabel("all attackers weaker by, Elo points")
    ax.set_ylabel("what a final defender gains, Elo points")
    ax.legend(fontsize=8.5)
    ax.grid(alpha=0.25)


def _by_whose_attackers(ax: Axes, protocol: Protocol) -> None:
    pools = np.where(np.eye(len(protocol.runs), dtype=bool), np.nan, protocol.pools)
    known = np.isfinite(pools)
    if len(protocol.runs) < 3 or not known.any():
        ax.set_title("By whose attackers", fontsize=11)
        return nothing(ax, "no defender met the attackers of two other runs")
    mean = np.where(known, pools, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    away = pools - mean[:, None]
    order = sorted(range(len(protocol.runs)), key=lambda run: protocol.methods[run])
    for method, colour in zip((IPPO, SIPPO), METHOD_COLOURS, strict=False):
        places = [place for place, run in enumerate(order) if protocol.methods[run] == method]
        columns = away[:, [order[place] for place in places]]
        x = np.broadcast_to(np.asarray(places, float), columns.shape)
        ax.plot(x.ravel(), columns.ravel(), ".", color=colour, label=f"{method}'s attackers")
    ax.axhline(0.0, color="#000000", linewidth=0.6)
    ax.set_title(f"By whose attackers: {protocol.by_attackers:+.0f}", fontsize=11)
    ax.set_xticks([])
    ax.set_xlabel("whose attackers: each column a run")
    ax.set_ylabel("Elo of the same defender, over its mean")
    ax.legend(fontsize=8.5)
    ax.grid(alpha=0.25, axis="y")
