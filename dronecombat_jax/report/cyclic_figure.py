"""The figure of what no rating can explain: who suits whom."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dronecombat_jax.analysis.cyclic import CyclicShare
from dronecombat_jax.analysis.result import Entrant, TournamentResult, by_training
from dronecombat_jax.analysis.study import ALL, Study
from dronecombat_jax.report.figures import ROLE_COLOURS
from dronecombat_jax.report.sheet import games, name, nothing, sheet
from dronecombat_jax.types import SIDES


def cyclic_discs(study: Study) -> Figure:
    """The part of the scores that no rating explains, in its two largest dimensions."""
    samples = next((value.samples for value in study.cyclic.values() if value is not None), 0)
    foot = (
        "A defender scores better than its rating says against attackers that lie in its own direction from the centre, "
        "worse against the opposite ones; the further out, the more. Lines: seeds in order of training, dot: the final "
        "policy, star: a scripted pilot. Share: of the logits' variance, corrected for the noise of finitely many "
        f"fights; p: of 'no cyclic part', parametric bootstrap of {samples} samples. {games(study.result)}"
    )
    panels = list(study.cyclic.items())
    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    figure, axes = sheet(
        rows, columns, (5.4, 5.2), "Cyclic part: who suits whom, beyond strength", foot
    )
    flat = [ax for row in axes for ax in row]
    for ax, (title, share) in zip(flat, panels, strict=False):
        heading = title if title == ALL else f"{name(title)} among itself"
        if share is None:
            nothing(ax, "no part of the tournament is without missing cells")
            ax.set_title(heading, fontsize=11)
        else:
            _disc(ax, study.cyclic_part[title], share, heading)
    for ax in flat[len(panels) :]:
        ax.set_visible(False)
    return figure


def _disc(ax: Axes, part: TournamentResult, share: CyclicShare, heading: str) -> None:
    for role, side, points in zip(
        SIDES,
        (part.defenders, part.attackers),
        (share.defender_disc, share.attacker_disc),
        strict=True,
    ):
        _paths(ax, side, points, role)
    reach = 1.1 * max(
        np.abs([*share.defender_disc.ravel(), *share.attacker_disc.ravel()]).max(), 0.05
    )
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    ax.axhline(0.0, color="#999999", linewidth=0.6)
    ax.axvline(0.0, color="#999999", linewidth=0.6)
    held = (
        ""
        if np.isnan(share.disc_share)
        else f"\nthese two dimensions hold {_percent(share.disc_share)} of it"
    )
    least = ", the least possible" if share.p_value <= 1 / (1 + share.samples) else ""
    verdict = least if share.p_value < 0.05 else ": no more than noise"
    ax.set_title(
        f"{heading}\ncyclic share {_percent(share.corrected)} (raw {_percent(share.raw)}, noise "
        f"{_percent(share.null_mean)}), p {share.p_value:.2g}{verdict}{held}",
        fontsize=9.5,
    )
    ax.set_xlabel("first dimension [square root of log-odds]")
    ax.set_ylabel("second dimension [square root of log-odds]")
    ax.legend(fontsize=9, framealpha=0.85)


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if np.isfinite(share) else "unknown"


def _paths(ax: Axes, side: tuple[Entrant, ...], points: NDArray, role: str) -> None:
    """One path a seed, and the pilots."""
    trained = [[index for index, _ in saved] for saved in by_training(side).values()]
    pilots = [[index] for index, entrant in enumerate(side) if not entrant.lineage]
    for number, members in enumerate([*trained, *pilots]):
        x, y = points[members].T
        colour, label = ROLE_COLOURS[role], role if number == 0 else None
        if side[members[0]].lineage:
            ax.plot(x, y, color=colour, linewidth=0.8, alpha=0.5, label=label)
            ax.plot(x[-1:], y[-1:], "o", color=colour, markersize=5)
        else:
            ax.plot(x, y, "*", color=colour, markersize=9, label=label, linestyle="")
