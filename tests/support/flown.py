"""Rows of recorded fights, made up; shared by the tests of the file and of the figure."""

import math

from dronecombat_jax.tournaments.flights import Flown


def rows(chunks: int) -> list[Flown]:
    """Two seeds of two methods with `chunks` chunks; seed s closes at 1 + s + 10 chunk m/s."""
    return [
        Flown(f"{method}#{seed}", method, chunk, 1000 * chunk, 8, 2.0, 1.0 + seed + 10.0 * chunk, math.pi / 2,
              (1.5, 2.5), (0.5, 0.6), (1.1, 1.2), (0.9, 0.8))
        for method in ("ippo", "s-ippo") for seed in (0, 1) for chunk in range(1, chunks + 1)
    ]  # fmt: skip
