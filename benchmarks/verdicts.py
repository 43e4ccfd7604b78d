"""How often `dronecombat compare` errs: verdicts and intervals on simulated tournaments of equal methods.

    python -m benchmarks.verdicts [--comparisons 400] [--seeds 8] [--fights 50] [--seed 0]

Every simulated tournament has final policies only, `--seeds` runs of each of two methods whose defenders are equal on
average, and goes through `report.verdict.judge`, as a real one does. Prints a Markdown table, a row a situation:

- YES: share of verdicts that name a better method. The level is 0.05. "Plain": by the permutation test of plain means;
- Welch, new attackers: share of 95 % intervals that hold the true difference, which is 0;
- equivalent: share of verdicts that would call methods equivalent that are 25 Elo apart. The level is 0.05;
- secondary: share of verdicts with a finding among the secondary questions. The level is 0.05 after Holm.

What does not live here: the statistics themselves (`dronecombat_jax.arena`).
"""

import argparse
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from dronecombat_jax.arena.bradley_terry import POINTS
from dronecombat_jax.arena.compare import LEVEL, MARGIN, elo_of_score, equivalence
from dronecombat_jax.arena.panel import Panel, away_panel
from dronecombat_jax.arena.permutation import permutation_test
from dronecombat_jax.arena.result import Entrant, TournamentResult, tournament_result
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.config import Config
from dronecombat_jax.report.verdict import judge
from dronecombat_jax.types import ROLES, Cause

METHODS = ("ippo", "s-ippo")
CENTRE = 0.45  # mean score of all defenders


class Situation(NamedTuple):
    """What is true in a simulated tournament; numbers are of the defender's chance to win."""

    name: str
    seed_sd: float  # of the defenders' strengths over seeds, and of the attackers'
    attacker_gap: float  # what a defender scores more against the first method's attackers
    suits_sd: float = 0.0  # of who suits whom: each cell's own deviation from the sum of two strengths
    fewer: int = 0  # seeds that the second method has less


SITUATIONS = (
    Situation("steady seeds, attackers equal", 0.0, 0.0),
    Situation("steady seeds, attackers unequal", 0.0, 0.3),
    Situation("varying seeds, attackers equal", 0.1, 0.0),
    Situation("varying seeds, attackers unequal", 0.1, 0.3),
)
MORE = (
    Situation("varying, unequal, who suits whom", 0.1, 0.3, suits_sd=0.1),
    Situation("varying, unequal, two seeds fewer", 0.1, 0.3, fewer=2),
)


class Rates(NamedTuple):
    """Shares of the simulated comparisons."""

    plain_yes: float
    yes: float
    welch: float
    new_attackers: float
    equivalent: float
    secondary: float


def main() -> None:
    """Read the flags, simulate, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--comparisons", type=int, default=400, help="in each situation (default %(default)s)")
    parser.add_argument("--seeds", type=int, default=8, help="runs of each method (default %(default)s)")
    parser.add_argument("--fights", type=int, default=50, help="of each pair (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the random numbers (default %(default)s)")
    flags = parser.parse_args()
    print("| situation | YES, plain | YES | Welch | new attackers | equivalent | secondary |")
    print("|---|---|---|---|---|---|---|")
    for number, situation in enumerate((*SITUATIONS, *MORE)):
        rng = np.random.default_rng([flags.seed, number])
        rates = simulate(situation, flags.comparisons, flags.seeds, flags.fights, rng)
        print(f"| {situation.name} | {' | '.join(f'{rate:.3f}' for rate in rates)} |", flush=True)


def simulate(situation: Situation, comparisons: int, seeds: int, fights: int, rng: np.random.Generator) -> Rates:
    """Judge `comparisons` tournaments of `situation`, and test each for equivalence with a margin's difference planted."""
    told = []
    for _ in range(comparisons):
        verdict = judge(tournament(chances(situation, seeds, rng), seeds, fights, rng), METHODS)
        numbers, panel = verdict.answers[0].numbers, verdict.panel
        apart = tournament(chances(situation, seeds, rng, MARGIN), seeds, fights, rng)
        told.append(
            Rates(
                plain_yes=float(permutation_test(*by_method(panel, panel.plain)).p_value) < LEVEL,
                yes=verdict.answers[0].sentence.startswith("YES"),
                welch=numbers.adjusted_score.low <= 0 <= numbers.adjusted_score.high,
                new_attackers=numbers.new_attackers[0] <= 0 <= numbers.new_attackers[1],
                equivalent=equivalence(*points(away_panel(apart))) < LEVEL,
                secondary=any(one.adjusted_p < LEVEL for one in verdict.answers[0].secondary),
            )
        )
    return Rates(*np.mean(told, axis=0).tolist())


def chances(situation: Situation, seeds: int, rng: np.random.Generator, apart: float = 0.0) -> NDArray[np.float64]:
    """The defender's chance [R, R] to win each cell; the second method's defenders are better by `apart` points."""
    second = seeds - situation.fewer
    method = np.repeat([0, 1], [seeds, second])
    half = logit(CENTRE) + np.array([-0.5, 0.5]) * apart / POINTS
    defender = expit(half)[method] + rng.normal(0, situation.seed_sd, len(method))
    attacker = situation.attacker_gap * (0.5 - method) + rng.normal(0, situation.seed_sd, len(method))
    suits = rng.normal(0, situation.suits_sd, (len(method), len(method)))
    return np.clip(defender[:, None] + attacker + suits, 0.0, 1.0)


def tournament(chance: NDArray, seeds: int, fights: int, rng: np.random.Generator) -> TournamentResult:
    """A cross-play of final policies with independent fights; the first `seeds` rows and columns are of one method."""
    method = [METHODS[row >= seeds] for row in range(len(chance))]
    seed = [row - seeds * (row >= seeds) for row in range(len(chance))]
    sides = [
        [Entrant(f"{role} {m} {s}", f"{m} {s}", m, m, s, 1, 1) for m, s in zip(method, seed, strict=True)]
        for role in ROLES
    ]
    won = rng.random((*chance.shape, fights)) < chance[..., None]
    cause = np.where(won, np.int8(Cause.INTERCEPT), np.int8(Cause.REACHED))
    config = Config()
    return tournament_result(cause, np.ones_like(cause, int), outcome_table(config.game), *sides, config.control_dt)


def points(panel: Panel) -> list[NDArray[np.float64]]:
    """Each method's adjusted scores in Elo points, as `arena.compare` tests them for equivalence."""
    return by_method(panel, elo_of_score(panel.adjusted, panel.fights))


def by_method(panel: Panel, values: NDArray) -> list[NDArray]:
    """`values` [R] of each of the two methods."""
    return [values[np.asarray(panel.methods) == method] for method in METHODS]


if __name__ == "__main__":
    main()
