"""What the paper's protocol shows of equal defenders: docs/paper_protocol.png.

    python -m benchmarks.paper_protocol [--weaker 200] [--out docs/paper_protocol.png]
    python -m benchmarks.paper_protocol --tournament reproductions/laptop/tournaments/all

Plants a tournament of IPPO and S-IPPO, `--seeds` runs each, whose defenders are equal but for their
seeds and chance, and in which S-IPPO's attackers are weaker; or reads a real one. Prints what
rating the two in pools of their own shows of it, and draws the figure of a report.

What does not live here: the examination itself (`dronecombat_jax.analysis.protocol`).
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.special import expit

from dronecombat_jax.analysis.bradley_terry import POINTS
from dronecombat_jax.analysis.panel import EVERY
from dronecombat_jax.analysis.protocol import Protocol, paper_protocol
from dronecombat_jax.analysis.result import (
    Entrant,
    TournamentResult,
    first_episodes,
    tournament_result,
)
from dronecombat_jax.analysis.study import ELO_EPISODES, own_elo
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.config.fields import Config
from dronecombat_jax.report.figures import save_figure
from dronecombat_jax.report.protocol_figure import protocol_figure
from dronecombat_jax.tournaments.grouping import as_compared
from dronecombat_jax.tournaments.result_file import load_about, load_result
from dronecombat_jax.types import SIDES, Cause

METHODS = ("ippo", "s-ippo")
SEED_SD = 50.0  # points, of a run's defenders
CHUNKS = 20
FLAGS = {
    "weaker": (200, "points, S-IPPO's attackers below IPPO's"),
    "seeds": (8, "runs of each method"),
    "seed": (0, "of the random numbers"),
}


def main() -> None:
    """Read the flags, examine, draw, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    for name, (default, text) in FLAGS.items():
        parser.add_argument(f"--{name}", type=int, default=default, help=f"{text} (%(default)s)")
    parser.add_argument("--tournament", default="", help="a real one instead: its folder")
    parser.add_argument("--out", type=Path, default=Path("docs/paper_protocol.png"))
    given = parser.parse_args()
    if given.tournament:
        result, about = as_compared(load_result(given.tournament), load_about(given.tournament))
        every = about.every
    else:
        result, every = planted(given.weaker, given.seeds, given.seed), 2
    protocol = examine(result, every)
    if protocol is None:
        parser.error(f"{given.tournament}: it has not both methods with own attackers")
    save_figure(protocol_figure(protocol), given.out)
    print(summary(protocol))
    print(f"drawn: {given.out}")


def examine(result: TournamentResult, every: int = EVERY) -> Protocol | None:
    """The protocol's examination, by the first 5 fights a cell as the paper rates."""
    rated = first_episodes(result, min(ELO_EPISODES, result.cause.shape[2]))
    return paper_protocol(rated, own_elo(rated, 8), every)


def summary(protocol: Protocol) -> str:
    """What a person reads."""
    low, high = np.quantile(protocol.by_chance, [0.025, 0.975])
    lifts = protocol.lifted.mean(axis=0) if len(protocol.lifted) else []
    planted_lines = [
        f"all attackers {points:.0f} points weaker, nothing else: {lift:+.0f}"
        for points, lift in zip(protocol.weaker, lifts, strict=False)
    ]
    return "\n".join(
        [
            f"S-IPPO minus IPPO, each in pools of its own: {protocol.difference:+.0f} points",
            f"by chance (relabelled seeds): 95 % within {low:+.0f} to {high:+.0f}, "
            f"p = {protocol.p_value:.2g}",
            *planted_lines,
            f"the same defenders, S-IPPO's attackers instead of IPPO's: {protocol.by_attackers:+.0f}",
        ]
    )


def planted(weaker: float, seeds: int, seed: int) -> TournamentResult:
    """Equal defenders but for their seeds; everybody meets everybody, 5 fights a cell."""
    rng = np.random.default_rng(seed)
    defenders, attackers = (
        [
            Entrant(f"{role}-{method}-{run}-{chunk}", f"{method} {run}", method, method, run, chunk, chunk)
            for method in METHODS
            for run in range(seeds)
            for chunk in range(1, CHUNKS + 1)
        ]
        for role in SIDES
    )  # fmt: skip
    strength = np.repeat(rng.normal(0.0, SEED_SD, len(METHODS) * seeds), CHUNKS)
    weakness = np.asarray([weaker * (entrant.method == METHODS[1]) for entrant in attackers])
    chance = rng.random((len(defenders), len(attackers), ELO_EPISODES))
    won = chance < expit((strength[:, None] + weakness) / POINTS)[..., None]
    cause = np.where(won, Cause.INTERCEPT, Cause.REACHED).astype(np.int8)
    config = Config()
    winner = outcome_table(config.game)
    steps = np.ones(cause.shape, int)
    return tournament_result(cause, steps, winner, defenders, attackers, config.control_dt)


if __name__ == "__main__":
    main()
