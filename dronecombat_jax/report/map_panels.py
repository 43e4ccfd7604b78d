"""What a map of one method shows: which defenders and attackers, their numbers, where they stand
in a picture.

What does not live here: drawing them (`map_figures`), the fights behind them (`pairs_page`).
"""

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dronecombat_jax.analysis.forgetting import summarise_maps
from dronecombat_jax.analysis.map_tests import shown_defenders
from dronecombat_jax.analysis.result import by_training, showings
from dronecombat_jax.analysis.study import Study
from dronecombat_jax.types import ATTACKER, DEFENDER


class Panel(NamedTuple):
    """The map of one method: ten defenders against all attackers."""

    method: str
    runs: tuple[str, ...]  # `Entrant.lineage` of its runs
    seeds: int  # most runs that played a cell
    defenders: NDArray[np.integer]  # [R] their chunks
    attackers: NDArray[np.integer]  # [C] their chunks
    values: NDArray[np.float64]  # [R, C] NaN where not played


class Area(NamedTuple):
    """Where a cell is in a picture: shares of its width and height, from the upper left."""

    cell: tuple[int, int, int]  # map, row, column
    left: float
    top: float
    width: float
    height: float


def panel_of(study: Study, method: str, variance: bool = False) -> Panel | None:
    """The map of a method: mean or variance over its runs; None where no run met its attackers."""
    maps = study.win_maps[method]
    summary = summarise_maps(maps) if maps else None
    if summary is None or not summary.runs.max():
        return None
    rows, columns = (np.flatnonzero((summary.runs > 0).any(axis=axis)) for axis in (1, 0))
    rows = rows[shown_defenders(len(rows))]
    chunks = maps[0].chunks
    values = (summary.variance if variance else summary.mean)[np.ix_(rows, columns)]
    runs = tuple(run_map.run for run_map in maps)
    return Panel(method, runs, int(summary.runs.max()), chunks[rows], chunks[columns], values)


def panel_steps(study: Study, panel: Panel) -> tuple[list[int], list[int]]:
    """Environment steps trained of the defenders and the attackers of a map."""
    sides = study.result.defenders, study.result.attackers
    steps = []
    for side, chunks in zip(sides, (panel.defenders, panel.attackers), strict=True):
        known = {
            entrant.chunk: entrant.steps
            for _, entrant in showings(side)
            if entrant.lineage in panel.runs
        }
        steps.append([known[int(chunk)] for chunk in chunks])
    return steps[DEFENDER], steps[ATTACKER]


def pairs_of(study: Study, panel: Panel, run: str) -> NDArray[np.int32]:
    """[R, C, 2] the defender and the attacker (indices of the result) of `run` in each cell, -1
    where it did not play.
    """
    result = study.result
    index = []
    for side, chunks in (
        (result.defenders, panel.defenders),
        (result.attackers, panel.attackers),
    ):
        known = {entrant.chunk: i for i, entrant in by_training(side).get(run, ())}
        index.append(np.asarray([known.get(int(chunk), -1) for chunk in chunks], np.int32))
    pairs = np.stack(np.meshgrid(*index, indexing="ij"), axis=-1)
    played = (pairs >= 0).all(axis=-1) & result.played[pairs[..., 0], pairs[..., 1]]
    return np.where(played[..., None], pairs, -1)


def areas(figure: Figure) -> list[Area]:
    """Where the cells of the maps of a figure that was laid out are; maps count from the left."""
    width, height = figure.get_size_inches() * figure.dpi
    regions = []
    maps = [ax for ax in figure.axes if ax.images and ax.get_label() != "<colorbar>"]
    for number, ax in enumerate(maps):
        rows, columns = np.shape(np.asarray(ax.images[0].get_array()))
        for row, column in np.ndindex(rows, columns):
            corners = [(column - 0.5, row + 0.5), (column + 0.5, row - 0.5)]
            (left, upper), (right, lower) = ax.transData.transform(corners)
            box = (left / width, 1 - upper / height)
            size = ((right - left) / width, (upper - lower) / height)
            regions.append(Area((number, row, column), *box, *size))
    return regions
