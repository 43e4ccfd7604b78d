"""The result of a tournament: every outcome of every cell, who took part, and the plain counts and
rates.

Ratings and statistics are pure functions of a `TournamentResult`; what plays the fights
(`tournament`) and what stores the result does not live here. Axes: D defenders, A attackers, E
episodes, C causes; episode e starts from the same state in every cell. A cell that was not played
is marked by `played` and never by zeros.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.types import Cause, Outcome

SCRIPTED = "scripted"  # the `method` of a pilot that was not trained


class Alias(NamedTuple):
    """Another place where a player was saved: a policy that did not learn in a chunk is saved
    again, unchanged.
    """

    label: str
    method: str
    run: str
    seed: int
    chunk: int
    steps: int


class Entrant(NamedTuple):
    """One player, on one side."""

    identity: str  # digest of its parameters, or the scripted pilot's name; once on each side
    label: str  # for people
    method: str  # such as "ippo", "s-ippo", SCRIPTED
    run: str  # the run that it comes from, which may hold several seeds; "" for a scripted pilot
    seed: int  # -1: none
    chunk: int  # chunks of training done when it was saved, 0: untrained; -1: none
    steps: int  # environment steps trained until then
    also: tuple[Alias, ...] = ()  # it flies once, under its first name

    @property
    def lineage(self) -> str:
        """The training (run and seed) that made this entrant, the unit of every statistic; "" for a
        scripted pilot.
        """
        return f"{self.run}#{self.seed}" if self.run else ""


class TournamentResult(NamedTuple):
    """A round robin as played; built by `tournament_result`, which checks it."""

    counts: NDArray[np.integer]  # [D, A, C] fights ended by each `Cause`; 0 where not played
    # [D, A, E] `Cause` of each fight, in order of episode; NONE where not played
    cause: NDArray[np.int8]
    steps: NDArray[np.integer]  # [D, A, E] control steps flown; 0 where not played
    played: NDArray[np.bool_]  # [D, A]
    winner: tuple[Outcome, ...]  # [C] who wins by each `Cause`: `combat.rules.outcome_table`
    defenders: tuple[Entrant, ...]
    attackers: tuple[Entrant, ...]
    control_dt: float  # s


class Scores(NamedTuple):
    """Outcomes by cell, each [D, A] int; all three are 0 where not played."""

    wins: NDArray[np.integer]  # of the defender
    ties: NDArray[np.integer]
    losses: NDArray[np.integer]


def tournament_result(
    cause: NDArray[Any],
    steps: NDArray[Any],
    winner: Sequence[Outcome],
    defenders: Sequence[Entrant],
    attackers: Sequence[Entrant],
    control_dt: float,
    played: NDArray[Any] | None = None,
) -> TournamentResult:
    """Check and count raw outcomes `cause` and `steps`, both [D, A, E]; `played` [D, A] defaults to
    "no cause is NONE".

    A `winner` shorter than C, from before the last causes were added, serves if none of those
    occurs. Raises `UserError` (data) that names the first contradiction: shapes, an unknown cause,
    a played cell with a fight that has not ended, an outcome or a duration in a cell that was not
    played, an entrant twice on a side.
    """
    cause, steps = np.asarray(cause), np.asarray(steps)
    shape = (len(defenders), len(attackers))
    if (
        cause.ndim != 3
        or cause.shape[:2] != shape
        or steps.shape != cause.shape
        or 0 in cause.shape
    ):
        _refuse(
            f"causes {cause.shape} and durations {steps.shape} must both be [{shape[0]}, {shape[1]}, E], E > 0"
        )
    if cause.dtype.kind not in "iu" or steps.dtype.kind not in "iu":
        _refuse(f"causes and durations must be integers, not {cause.dtype} and {steps.dtype}")
    if not 0 < len(winner) <= len(Cause):
        _refuse(f"{len(winner)} winners for {len(Cause)} causes")
    if cause.min() < 0 or cause.max() >= len(winner):
        _refuse(f"causes {cause.min()} to {cause.max()} are not all in 0..{len(winner) - 1}")
    ended = cause != Cause.NONE
    mask = ended.all(axis=2) if played is None else np.asarray(played, bool)
    if mask.shape != shape:
        _refuse(f"`played` is {mask.shape}, not {shape}")
    if not np.array_equal(ended, np.broadcast_to(mask[:, :, None], ended.shape)):
        _refuse("a played cell needs an outcome in every episode, and a missing one has none")
    if not np.array_equal(steps > 0, ended):
        _refuse("a fight lasts at least one control step, and one that was not played none")
    for side, entrants in (("defender", defenders), ("attacker", attackers)):
        names = [entrant.identity for entrant in entrants]
        if twice := {name for name in names if names.count(name) > 1}:
            _refuse(f"{side} {min(twice)} takes part twice")
    return TournamentResult(
        counts=count_causes(cause),
        cause=cause.astype(np.int8),
        steps=steps,
        played=mask,
        winner=tuple(Outcome(outcome) for outcome in winner)
        + (Outcome.DRAW,) * (len(Cause) - len(winner)),
        defenders=tuple(defenders),
        attackers=tuple(attackers),
        control_dt=float(control_dt),
    )


def showings(entrants: Sequence[Entrant]) -> list[tuple[int, Entrant]]:
    """Each entrant (index) under each of its names.

    A head start saves the defender again and again as it was, a frozen chunk the attacker. Such a
    policy flies and is rated once; whatever is shown over training shows it at every chunk.
    """
    every = lambda entrant: (
        entrant._replace(also=()),
        *(entrant._replace(also=(), **name._asdict()) for name in entrant.also),
    )
    return [(index, shown) for index, entrant in enumerate(entrants) for shown in every(entrant)]


def by_training(entrants: Sequence[Entrant]) -> dict[str, list[tuple[int, Entrant]]]:
    """The players that each training saved, by lineage: the `showings`, in order of chunk, one for
    each chunk.
    """
    lineages: dict[str, dict[int, tuple[int, Entrant]]] = {}
    for index, entrant in sorted(showings(entrants), key=lambda pair: pair[1].chunk):
        if entrant.lineage:
            lineages.setdefault(entrant.lineage, {})[entrant.chunk] = index, entrant
    return {lineage: list(saved.values()) for lineage, saved in lineages.items()}


def count_causes(cause: NDArray[Any]) -> NDArray[np.int32]:
    """Fights [D, A, C] by `Cause`, of `cause` [D, A, E]; NONE is not counted."""
    counts = np.stack([np.sum(cause == which, axis=2, dtype=np.int32) for which in Cause], axis=2)
    counts[:, :, Cause.NONE] = 0
    return counts


def scores(result: TournamentResult) -> Scores:
    """The defender's wins, the ties and its losses in each cell."""
    who = np.asarray(result.winner)
    by = lambda outcome: result.counts[:, :, who == outcome].sum(axis=2)
    return Scores(by(Outcome.DEFENDER), by(Outcome.DRAW), by(Outcome.ATTACKER))


def score_rate(result: TournamentResult) -> NDArray[np.float64]:
    """The defender's mean score [D, A]: a win 1, a tie 1/2, a loss 0; NaN where not played."""
    return np.where(result.played, fight_scores(result).mean(axis=2), np.nan)


def win_rate(result: TournamentResult) -> NDArray[np.float64]:
    """The share of fights that the defender wins [D, A], as in the paper's figures 6 and 7; NaN
    where not played.
    """
    return np.where(result.played, scores(result).wins / result.cause.shape[2], np.nan)


def fight_scores(result: TournamentResult) -> NDArray[np.float64]:
    """The defender's score in every fight [D, A, E]: 1, 1/2 or 0; NaN where not played (eq. 4)."""
    return score_of(result.winner)[result.cause]


def score_of(winner: Sequence[Outcome]) -> NDArray[np.float64]:
    """The defender's score by `Cause` [C]: 1, 1/2 or 0; NaN for NONE. `winner` [C]: who wins by it."""
    value = {Outcome.DEFENDER: 1.0, Outcome.DRAW: 0.5, Outcome.ATTACKER: 0.0}
    table = np.asarray([value[outcome] for outcome in winner])
    table[Cause.NONE] = np.nan
    return table


def select(
    result: TournamentResult, defenders: NDArray[Any], attackers: NDArray[Any]
) -> TournamentResult:
    """The part of a tournament between the given indices of `defenders` and `attackers`, in that
    order.
    """
    cells = np.ix_(np.asarray(defenders, int), np.asarray(attackers, int))
    return result._replace(
        counts=result.counts[cells],
        cause=result.cause[cells],
        steps=result.steps[cells],
        played=result.played[cells],
        defenders=tuple(result.defenders[index] for index in defenders),
        attackers=tuple(result.attackers[index] for index in attackers),
    )


def first_episodes(result: TournamentResult, episodes: int) -> TournamentResult:
    """The same tournament cut to its first `episodes` a cell (the paper rates by 5 and maps by
    100).
    """
    if not 1 <= episodes <= result.cause.shape[2]:
        raise ValueError(f"{episodes} episodes of {result.cause.shape[2]}")
    cause = result.cause[:, :, :episodes]
    return result._replace(
        counts=count_causes(cause), cause=cause, steps=result.steps[:, :, :episodes]
    )


def _refuse(reason: str) -> None:
    raise UserError(f"tournament result: {reason}", EXIT_DATA)
