"""The tournament as a zero-sum game between a side that picks a defender and one that picks an
attacker.

Unlike mean scores, value and averaging do not change when an entrant is entered ten times over. All
functions need a whole matrix of the defender's mean scores M [D, A] (`design.complete_part`); they
raise ValueError for NaN.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from dronecombat_jax.analysis.result import TournamentResult, fight_scores

NOTHING = 1e-30  # share of an entrant that is not in the mixture
SLACK = 1e-5  # of score: how far from optimal a mixture may be to be the more mixed one


class MatrixGame(NamedTuple):
    """An equilibrium of one game."""

    # max over x of min over j of (x' M)_j: the defender's mean score when both sides mix optimally
    value: float
    defender_mix: NDArray[np.float64]  # [D] x
    attacker_mix: NDArray[np.float64]  # [A] y
    gap: float  # certificate: max_i (M y)_i - min_j (x' M)_j, 0 at an equilibrium


class NashAverage(NamedTuple):
    """Nash averaging: each entrant's mean score against the other side's equilibrium.

    Balduzzi et al. (2018).
    """

    defender: NDArray[np.float64]  # [D] the defender's score against y: at most about the value
    attacker: NDArray[np.float64]  # [A] the attacker's own score against x: at most about 1 - value
    game: MatrixGame  # the most mixed equilibrium to within SLACK, which is unique


class PopulationValue(NamedTuple):
    """The value of one population of defenders against the common attackers."""

    value: float
    low: float  # 95 % interval over start states: other entrants or runs would vary it further
    high: float
    defender_mix: NDArray[np.float64]  # [members]
    attacker_mix: NDArray[np.float64]  # [A]


def solve(scores: NDArray[Any]) -> MatrixGame:
    """An equilibrium of M = `scores` [D, A] by linear programming (HiGHS); the value is unique, the
    mixtures may not be.
    """
    scores = np.asarray(scores, float)
    if not scores.size or np.isnan(scores).any():
        raise ValueError("a matrix game needs every cell")
    num_defenders, num_attackers = scores.shape
    program = linprog(
        c=np.append(np.zeros(num_defenders), -1.0),
        A_ub=np.column_stack([-scores.T, np.ones(num_attackers)]),
        b_ub=np.zeros(num_attackers),
        A_eq=np.append(np.ones(num_defenders), 0.0)[None],
        b_eq=[1.0],
        bounds=[(0, None)] * num_defenders + [(None, None)],
        method="highs",
    )
    if program.status != 0:
        raise ArithmeticError(f"linear program: {program.message}")
    mixes = [np.maximum(mix, 0.0) for mix in (program.x[:-1], -program.ineqlin.marginals)]
    x, y = (mix / mix.sum() for mix in mixes)
    return MatrixGame(float(program.x[-1]), x, y, _gap(scores, x, y))


def nash_average(scores: NDArray[Any], slack: float = SLACK) -> NashAverage:
    """Average M = `scores` [D, A] over the opponents' equilibrium.

    Of all mixtures that give away at most `slack` of score, the one of largest entropy is taken on
    each side, so that the result is unique and does not depend on how the entrants are listed.
    """
    scores = np.asarray(scores, float)
    game = solve(scores)
    y = _most_mixed(scores, game.attacker_mix, game.value, slack)
    x = _most_mixed(-scores.T, game.defender_mix, -game.value, slack)
    mixed = MatrixGame(game.value, x, y, _gap(scores, x, y))
    return NashAverage(scores @ y, 1.0 - x @ scores, mixed)


def population_values(
    result: TournamentResult,
    populations: dict[str, NDArray[Any]],
    samples: int = 100,
    seed: int = 0,
) -> dict[str, PopulationValue]:
    """The value of each population (indices of defenders, by name) against all attackers of
    `result`.

    Every fight of the result must have been played. The interval is a percentile bootstrap over
    episodes, drawn once for all cells and populations, because episode e starts from the same state
    everywhere.
    """
    fights = fight_scores(result)
    episodes = fights.shape[2]
    rng = np.random.default_rng(seed)
    weights = [
        rng.multinomial(episodes, np.full(episodes, 1 / episodes)) / episodes
        for _ in range(samples)
    ]
    values = {}
    for name, members in populations.items():
        own = fights[np.asarray(members, int)]
        game = solve(own.mean(axis=2))
        sampled = [solve(own @ weight).value for weight in weights]
        low, high = np.quantile(sampled, [0.025, 0.975]) if sampled else (np.nan, np.nan)
        values[name] = PopulationValue(
            game.value, float(low), float(high), game.defender_mix, game.attacker_mix
        )
    return values


def _gap(scores: NDArray[Any], x: NDArray[Any], y: NDArray[Any]) -> float:
    return float((scores @ y).max() - (x @ scores).min())


def _most_mixed(
    scores: NDArray[Any], optimal: NDArray[Any], value: float, slack: float
) -> NDArray[np.float64]:
    """The y [A] of largest entropy with M y <= value + slack, sum y = 1; `optimal` satisfies it
    without slack.

    An interior-point method: minimise sum y log y - sum log(value + slack - M y) / t by Newton for
    growing t.
    """
    size = len(optimal)
    limit = value + slack
    spread = scores.mean(axis=1).max() - value  # what the uniform mixture gives away
    share = min(0.5, 0.5 * slack / max(spread, 1e-300))
    y = (1 - share) * optimal + share / size
    for sharpness in 10.0 ** np.arange(1, 11):
        for _ in range(100):
            room = limit - scores @ y
            gradient = 1.0 + np.log(y) + scores.T @ (1.0 / room) / sharpness
            hessian = np.diag(1.0 / y) + (scores.T / room**2) @ scores / sharpness
            solved = np.linalg.solve(hessian, np.column_stack([gradient, np.ones(size)]))
            # keeps the sum at 1
            step = solved[:, 1] * (solved[:, 0].sum() / solved[:, 1].sum()) - solved[:, 0]
            # The longest step that stays strictly inside, then as short as the objective demands.
            # who is at the floor holds nobody up
            drift, falling = scores @ step, (step < 0) & (y > 2 * NOTHING)
            reach = [*(room[drift > 0] / drift[drift > 0]), *(y[falling] / -step[falling])]
            length = min(1.0, 0.95 * min(reach, default=np.inf))
            # an entrant far from the support must not underflow
            y = np.maximum(y + length * step, NOTHING)
            if np.abs(step).max() < 1e-9:
                break
    return y / y.sum()
