"""A planted tournament of two methods with runs, training time and pilots, for the tests of the
report.
"""

import numpy as np
from scipy.special import expit
from tournaments import build, entrants

from dronecombat_jax.analysis.result import TournamentResult
from dronecombat_jax.types import Cause

METHODS = ("ippo", "s-ippo")
STEPS = 10_000_000  # environment steps a chunk


def planted(
    seeds: int = 3, chunks: int = 12, episodes: int = 20, gap: float = 0.35, seed: int = 0
) -> TournamentResult:
    """Both sides improve; the defenders of the second method are better by `gap` and forget less;
    two pilots a side.
    """
    rng = np.random.default_rng(seed)
    sides = [
        [
            one._replace(
                steps=one.chunk * STEPS, label=f"{one.method} seed {one.seed} chunk {one.chunk}"
            )
            if one.run
            else one
            for one in entrants(role, seeds, chunks, METHODS, 2)
        ]
        for role in "da"
    ]
    lift = {one.lineage: rng.normal(0, 0.2) for side in sides for one in side}
    x = np.zeros((len(sides[0]), len(sides[1])))
    for i, one in enumerate(sides[0]):
        second = one.method == METHODS[1]
        for j, other in enumerate(sides[1]):
            x[i, j] = (
                lift[one.lineage] - lift[other.lineage] + gap * second + 0.12 * max(one.chunk, 0)
            )
            x[i, j] -= 0.15 * max(other.chunk, 0)
            if one.run and other.run:
                # who is ahead by a few chunks wins, by more loses again: forgetting
                x[i, j] += (0.4 if second else 1.0) * np.sin((one.chunk - other.chunk) / 2)
    chance, win = rng.random((*x.shape, episodes)), expit(x)[..., None]
    ends = ((0.7 * win, Cause.INTERCEPT), (win, Cause.ATTACKER_CRASH), (win + 0.08, Cause.TIMEOUT))
    cause = np.full(chance.shape, Cause.REACHED, np.int8)
    for below, name in reversed(ends):
        cause = np.where(chance < below, np.int8(name), cause)
    return build(cause, sides[0], sides[1], rng.integers(50, 500, cause.shape))
