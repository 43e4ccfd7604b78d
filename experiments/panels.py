"""Panels beside each other that show how fights end over training: what `curves.py` and
`learnability.py` draw into.
"""

import textwrap
from collections.abc import Callable, Sequence

import dronecombat_jax.report  # noqa: F401 (imports Matplotlib whatever MPLBACKEND names)

# isort: split
from matplotlib.axes import Axes
from matplotlib.figure import Figure

COLUMNS = 4
TITLE = 44  # characters a line


def in_panels(titles: Sequence[str], draw: Callable[[Axes, int], None]) -> Figure:
    """A figure with a panel for each of `titles`, at least one; `draw` fills the one of a number. All
    show what the first one's legend names.
    """
    columns = min(COLUMNS, len(titles))
    rows = -(-len(titles) // columns)
    figure = Figure(figsize=(4.2 * columns, 2.9 * rows + 0.8), layout="constrained")
    axes = figure.subplots(rows, columns, sharey=True, squeeze=False).ravel()
    for number, (ax, title) in enumerate(zip(axes, titles, strict=False)):
        draw(ax, number)
        ax.set_title("\n".join(textwrap.wrap(title, TITLE)), fontsize=9)
        ax.set_ylim(0.0, 1.0)
    for ax in axes[len(titles) :]:
        ax.set_axis_off()
    figure.supxlabel("environment steps, millions")
    figure.supylabel("share of ended fights")
    handles, labels = axes[0].get_legend_handles_labels()
    ncols = min(len(labels), 2 * columns)
    figure.legend(handles, labels, loc="outside upper center", ncols=ncols, frameon=False)
    return figure
