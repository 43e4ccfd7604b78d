"""What final policies are worth: their ratings among themselves and the scripted pilots, and their scores
against their own past.

    dronecombat tournament RUN ... scripted:all --every 7 --episodes 20
    python experiments/finals.py tournaments/NAME

Prints two tables in Markdown. Ratings: Bradley-Terry over the final policies of all trainings and the
scripted pilots alone, points. Past: a training's policies of one side against its own other side's; the
least score of the final one over all of these, less that of the best earlier one (docs/strength.md).
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent))

from measured import markdown_row

from dronecombat_jax.analysis.bradley_terry import bradley_terry
from dronecombat_jax.analysis.forgetting import run_maps
from dronecombat_jax.analysis.result import (
    SCRIPTED,
    Entrant,
    TournamentResult,
    by_training,
    scores,
)
from dronecombat_jax.errors import UserError
from dronecombat_jax.tournaments.result_file import load_result
from dronecombat_jax.types import SIDES


def main() -> None:
    """Read the flag, print both tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(".")[0])
    parser.add_argument("tournament", type=Path, help="its folder, or its result file")
    try:
        result = load_result(parser.parse_args().tournament)
    except UserError as error:
        parser.exit(error.exit_code, f"error: {error.message}\n")
    heads = ["side", "final policies: mean (least to most)", "scripted pilots"]
    print_rows(heads, ratings(result))
    print()
    print_rows(["side", "least score, final less best earlier: mean (least to most)"], past(result))


def ratings(result: TournamentResult) -> Iterator[list[str]]:
    """A row for each side, rated together."""
    sides = result.defenders, result.attackers
    taken = [[*finals(entrants), *scripted(entrants)] for entrants in sides]
    counts = scores(result)
    rated = bradley_terry(*(counts[i][np.ix_(*taken)] for i in range(3)))
    points = np.split(rated.rating, [len(taken[0])])
    for side, entrants, own in zip(SIDES, sides, points, strict=True):
        count = len(finals(entrants))
        names = [entrants[index].label for index in scripted(entrants)]
        best = sorted(zip(own[count:], names, strict=True), reverse=True)
        plain = ", ".join(f"`{name}` {rating:.0f}" for rating, name in best)
        yield [side, mean_and_range(own[:count], ".0f"), plain]


def past(result: TournamentResult) -> Iterator[list[str]]:
    """A row for each side."""
    maps = run_maps(result)
    for side, played in zip(
        SIDES, ([one.score for one in maps], [1.0 - one.score.T for one in maps]), strict=True
    ):
        least = [np.nanmin(score, axis=1) for score in played]
        yield [side, mean_and_range(np.array([one[-1] - one[:-1].max() for one in least]), "+.2f")]


def finals(entrants: Sequence[Entrant]) -> list[int]:
    """The newest policy of each training."""
    return [saved[-1][0] for saved in by_training(entrants).values()]


def scripted(entrants: Sequence[Entrant]) -> list[int]:
    """The pilots that were not trained."""
    return [index for index, entrant in enumerate(entrants) if entrant.method == SCRIPTED]


def mean_and_range(values: NDArray[np.float64], form: str) -> str:
    """Mean, least and most."""
    return f"{values.mean():{form}} ({values.min():{form}} to {values.max():{form}})"


def print_rows(heads: list[str], rows: Iterator[list[str]]) -> None:
    """A table in Markdown."""
    for cells in (heads, ["---"] * len(heads), *rows):
        print(markdown_row(cells))


if __name__ == "__main__":
    main()
