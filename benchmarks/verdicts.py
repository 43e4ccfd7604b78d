"""How often `dronecombat compare` errs: verdicts on simulated tournaments of equal methods.

    python -m benchmarks.verdicts [--comparisons 400] [--seeds 8] [--fights 50] [--seed 0]

Every simulated tournament has final policies only, `--seeds` runs of each of two methods whose
defenders are equal on average, and goes through `analysis.verdict.judge`, as a real one does.
Prints a Markdown table, a row a situation:

- YES: share of verdicts that name a better method. The level is 0.05. "Plain": the same by the
  permutation test of plain means;
- Welch, new attackers: share of 95 % intervals that hold the true difference, which is 0;
- equivalent: share of verdicts that would call methods equivalent that are 25 Elo apart. The
  level is 0.05;
- secondary: share of verdicts with a finding among the secondary questions. The level is 0.05
  after Holm.

What does not live here: the statistics themselves (`dronecombat_jax.arena`).
"""

import argparse
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from dronecombat_jax.analysis.bradley_terry import POINTS
from dronecombat_jax.analysis.compare import LEVEL, MARGIN, elo_of_score, equivalence
from dronecombat_jax.analysis.panel import Panel, away_panel
from dronecombat_jax.analysis.permutation import permutation_test
from dronecombat_jax.analysis.result import Entrant, TournamentResult, tournament_result
from dronecombat_jax.analysis.verdict import judge
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.config.fields import Config
from dronecombat_jax.types import SIDES, Cause

METHODS = ("ippo", "s-ippo")
CENTRE = 0.45  # mean score of all defenders
FLAGS = {
    "comparisons": (400, "in each situation"),
    "seeds": (8, "runs of each method"),
    "fights": (50, "of each pair"),
    "seed": (0, "of the random numbers"),
}
COLUMNS = ("situation", "YES, plain", "YES", "Welch", "new attackers", "equivalent", "secondary")


class Situation(NamedTuple):
    """What is true in a simulated tournament; numbers are of the defender's chance to win."""

    name: str
    seed_sd: float  # of the defenders' strengths over seeds, and of the attackers'
    attacker_gap: float  # what a defender scores more against the first method's attackers
    suits_sd: float = 0.0  # of who suits whom: a cell's own deviation from row + column
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
    for name, (default, text) in FLAGS.items():
        parser.add_argument(f"--{name}", type=int, default=default, help=f"{text} (%(default)s)")
    flags = parser.parse_args()
    print(f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
    for number, situation in enumerate((*SITUATIONS, *MORE)):
        rng = np.random.default_rng([flags.seed, number])
        rates = simulate(situation, flags.comparisons, flags.seeds, flags.fights, rng)
        cells = [situation.name, *(f"{rate:.3f}" for rate in rates)]
        print(f"| {' | '.join(cells)} |", flush=True)


def simulate(
    situation: Situation,
    comparisons: int,
    seeds: int,
    fights: int,
    rng: np.random.Generator,
) -> Rates:
    """Judge `comparisons` tournaments of equal methods; test as many others for equivalence."""
    rates = []
    for _ in range(comparisons):
        verdict = judge(tournament(chances(situation, seeds, rng), seeds, fights, rng), METHODS)
        (answer,), panel = verdict.answers, verdict.panel
        score, new = answer.numbers.adjusted_score, answer.numbers.new_attackers
        by_plain = permutation_test(*by_method(panel, panel.plain))
        apart = tournament(chances(situation, seeds, rng, MARGIN), seeds, fights, rng)
        rates.append(
            Rates(
                plain_yes=bool(by_plain.p_value < LEVEL),
                yes=answer.sentence.startswith("YES"),
                welch=score.low <= 0 <= score.high,
                new_attackers=new[0] <= 0 <= new[1],
                equivalent=equivalence(*points(away_panel(apart))) < LEVEL,
                secondary=any(other.adjusted_p < LEVEL for other in answer.secondary),
            )
        )
    return Rates(*map(float, np.mean(rates, axis=0)))


def chances(
    situation: Situation,
    seeds: int,
    rng: np.random.Generator,
    apart: float = 0.0,
) -> NDArray[np.float64]:
    """The defender's chance [R, R] to win; the second method's are `apart` points better."""
    method = np.repeat([0, 1], [seeds, seeds - situation.fewer])
    half = logit(CENTRE) + np.array([-0.5, 0.5]) * apart / POINTS
    sd, size = situation.seed_sd, len(method)
    defender = expit(half)[method] + rng.normal(0, sd, size)
    attacker = situation.attacker_gap * (0.5 - method) + rng.normal(0, sd, size)
    suits = rng.normal(0, situation.suits_sd, (size, size))
    return np.clip(defender[:, None] + attacker + suits, 0.0, 1.0)


def tournament(
    chance: NDArray,
    seeds: int,
    fights: int,
    rng: np.random.Generator,
) -> TournamentResult:
    """A cross-play of final policies; the first `seeds` rows and columns are of one method."""
    runs = [(METHODS[row >= seeds], row - seeds * (row >= seeds)) for row in range(len(chance))]
    sides = [tuple(entrant(role, method, seed) for method, seed in runs) for role in SIDES]
    won = rng.random((*chance.shape, fights)) < chance[..., None]
    cause = np.where(won, np.int8(Cause.INTERCEPT), np.int8(Cause.REACHED))
    config, steps = Config(), np.ones(cause.shape, int)
    winner = outcome_table(config.game)
    return tournament_result(cause, steps, winner, sides[0], sides[1], config.control_dt)


def entrant(role: str, method: str, seed: int) -> Entrant:
    """The one policy that a run has on this side."""
    name = f"{role} {method} {seed}"
    return Entrant(name, name, method, run=method, seed=seed, chunk=1, steps=1)


def points(panel: Panel) -> tuple[NDArray, NDArray]:
    """Each method's adjusted scores in points, as `analysis.compare` tests them for equivalence."""
    return by_method(panel, elo_of_score(panel.adjusted, panel.fights))


def by_method(panel: Panel, values: NDArray) -> tuple[NDArray, NDArray]:
    """`values` [R] of each of the two methods."""
    first = np.asarray(panel.methods) == METHODS[0]
    return values[first], values[~first]


if __name__ == "__main__":
    main()
