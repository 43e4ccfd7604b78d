"""Where the win-rate maps of two methods differ: cell by cell, with one error probability for a
whole map.
"""

from collections.abc import Mapping
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.analysis.compare import LEVEL
from dronecombat_jax.analysis.forgetting import RunMap
from dronecombat_jax.analysis.permutation import max_t_test, smallest_p

DEFENDERS_SHOWN = 10  # of the paper's figures 6 to 9


class MapTest(NamedTuple):
    """The cells of two methods' maps, tested at once by relabelling the seeds; R defenders are
    shown, T attackers.
    """

    first: str
    second: str
    seeds: tuple[int, int]
    defenders: NDArray[np.integer]  # [R] chunks
    attackers: NDArray[np.integer]  # [T] chunks
    # [R, T] mean win rate of the first method minus that of the second
    difference: NDArray[np.float64]
    adjusted_p: NDArray[np.float64]  # [R, T] max-T; NaN where some seed did not play the cell


def map_tests(win_maps: Mapping[str, tuple[RunMap, ...]]) -> tuple[MapTest, ...]:
    """Every pair of methods whose seeds have a cell in common; the defenders are those of the
    figure.
    """
    tests = []
    for first, second in combinations([method for method, maps in win_maps.items() if maps], 2):
        stacks = [
            np.stack([win_map.score for win_map in win_maps[method]]) for method in (first, second)
        ]
        common = ~np.any(np.isnan(np.concatenate(stacks)), axis=0)
        if not common.any():
            continue
        rows, columns = (np.flatnonzero(np.any(common, axis=axis)) for axis in (1, 0))
        rows = rows[shown_defenders(len(rows))]
        first_maps, second_maps = (stack[:, rows][:, :, columns] for stack in stacks)
        chunks = win_maps[first][0].chunks
        tests.append(
            MapTest(
                first,
                second,
                (len(first_maps), len(second_maps)),
                chunks[rows],
                chunks[columns],
                first_maps.mean(axis=0) - second_maps.mean(axis=0),
                max_t_test(first_maps, second_maps),
            )
        )
    return tuple(tests)


def shown_defenders(size: int) -> NDArray[np.integer]:
    """Ten of `size` checkpoints, evenly spaced, the first and the last among them."""
    return np.unique(np.linspace(0, size - 1, min(DEFENDERS_SHOWN, size)).round().astype(int))


def summary(test: MapTest) -> str:
    """One sentence for a person."""
    tested, differ = int(np.isfinite(test.adjusted_p).sum()), int(np.sum(test.adjusted_p < LEVEL))
    text = (
        f"Win-rate maps of {test.first} and {test.second}, against each run's own attackers: {differ} of {tested} cells "
        f"differ (max-T permutation test over all cells at once, {test.seeds[0]} v {test.seeds[1]} training seeds)."
    )
    if smallest_p(*test.seeds) >= LEVEL:
        text += " With so few seeds none could have differed."
    return text
