"""Tournaments with a planted truth, and their entrants; shared by the tests of ratings and
statistics.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from dronecombat_jax.analysis.result import SCRIPTED, Entrant, TournamentResult, tournament_result
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.config.fields import GameConfig
from dronecombat_jax.types import Cause

WINNER = outcome_table(GameConfig())
CONTROL_DT = 0.02
LETTERS = {"w": Cause.INTERCEPT, "d": Cause.TIMEOUT, "l": Cause.REACHED, ".": Cause.NONE}


def entrants(
    role: str, runs: int, chunks: int, methods: tuple[str, ...] = ("ippo",), scripted: int = 0
) -> list[Entrant]:
    """`runs` seeds of one run of each method with `chunks` entrants each, saved after chunk 1, 2,
    ..., then `scripted` pilots.
    """
    made = [
        Entrant(
            f"{role}-{method}-{seed}-{chunk}",
            f"{method} {seed}",
            method,
            method,
            seed,
            chunk,
            1000 * chunk,
        )
        for method in methods
        for seed in range(runs)
        for chunk in range(1, chunks + 1)
    ]
    return made + [
        Entrant(f"{role}-pilot-{one}", f"pilot {one}", SCRIPTED, "", -1, -1, 0)
        for one in range(scripted)
    ]


def from_letters(rows: list[list[str]]) -> TournamentResult:
    """A tournament written out: `rows[d][a]` such as "wdl", one letter a fight; dots: not played."""
    cause = np.asarray([[[LETTERS[one] for one in cell] for cell in row] for row in rows], np.int8)
    return build(cause)


def from_rates(
    win: NDArray, episodes: int, seed: int, tie: NDArray | float = 0.0, **sides
) -> TournamentResult:
    """`episodes` random fights a cell with the defender's chance `win` and the chance `tie` [D, A]."""
    chance = np.random.default_rng(seed).random((*win.shape, episodes))
    tie = np.broadcast_to(tie, win.shape)
    lost = np.where(chance < (win + tie)[..., None], Cause.TIMEOUT, Cause.REACHED)
    return build(np.where(chance < win[..., None], Cause.INTERCEPT, lost).astype(np.int8), **sides)


def build(
    cause: NDArray, defenders=None, attackers=None, steps: NDArray | None = None
) -> TournamentResult:
    """A tournament of `cause` [D, A, E]; without names every entrant is a chunk of one run."""
    defenders = entrants("d", 1, cause.shape[0]) if defenders is None else defenders
    attackers = entrants("a", 1, cause.shape[1]) if attackers is None else attackers
    steps = np.where(cause == Cause.NONE, 0, 10) if steps is None else steps
    return tournament_result(cause, steps, WINNER, defenders, attackers, CONTROL_DT)


def bradley_terry_rates(defender: NDArray, attacker: NDArray) -> NDArray:
    """The defender's chance [D, A] by strengths in log-odds."""
    return expit(defender[:, None] - attacker[None, :])


def words(runs: Path) -> list[str]:
    return [str(runs / "five"), "scripted:hover", "scripted:dash"]


def assert_same(result: TournamentResult, other: TournamentResult) -> None:
    for part in ("counts", "cause", "steps", "played"):
        np.testing.assert_array_equal(getattr(result, part), getattr(other, part))
    assert result.defenders == other.defenders and result.attackers == other.attackers
