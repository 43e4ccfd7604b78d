"""Ours beside other learners on the same game, in turns, on this machine: a Markdown table of steps
per second.

    make bench-peers        # or, in its environment: python -m benchmarks.peers.compare [--json FILE]

First `check` proves that the peers play our game. Then each part starts in a process of its own and
compiles; all stay alive and take turns, burst by burst, so that a shared host's drift hits all
alike. Rates are environment steps (two physics steps) per second; ratios are taken within each
round, the table shows the medians. Bursts in which other processes took more than 0.2 cores are
left out where at least three others are left. README.md says what is equal.
"""

import argparse
import json
import platform
import statistics
import subprocess
import sys
from contextlib import ExitStack
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.peers.turns import ROOT, Peer
from dronecombat_jax.machine import backend

TARGET = 3.0  # ours over a peer
DISTURBED = 0.2  # cores that other processes took during a burst
ENOUGH = 3  # undisturbed bursts, without which the disturbed ones count as well


class Part(NamedTuple):
    """One process."""

    title: str
    module: str
    arguments: tuple[str, ...] = ()
    learners: int = 2
    against: str | None = None  # the part of ours that does the same work


PARTS = {
    "ours": Part("ours", "ours", ("duel",)),
    "skrl": Part("skrl 1.4.3 IPPO (torch) on C MuJoCo, threads", "skrl_ippo", against="ours"),
    "purejaxrl": Part("purejaxrl-shaped IPPO, full mjx.Data", "purejaxrl_ippo", against="ours"),
    "one-learner": Part(
        "ours, one learner against a frozen policy", "ours", ("one-learner",), learners=1
    ),
    "brax": Part("brax PPO on our brax view", "brax_ppo", learners=1, against="one-learner"),
    "floor": Part("the bound: a 2048-cube product in NumPy over 5.0 MFLOP a step", "floor"),
    "two-seeds": Part("ours, two seeds on two virtual devices, summed", "ours", ("two-seeds",)),
}


def main() -> None:
    """Check, measure, print, write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=5, help="bursts of each part")
    parser.add_argument("--seconds", type=float, default=4.0, help="length of a burst")
    parser.add_argument("--json", type=Path, help="write all figures to this file, too")
    parser.add_argument(
        "--pause",
        action="store_true",
        help="wait for Enter before measuring, to quieten the machine",
    )
    options = parser.parse_args()
    if options.rounds < 1 or not options.seconds > 0.0:
        parser.error("--rounds must be at least 1 and --seconds above 0")
    missing = [name for name in ("torch", "skrl", "gymnasium") if not installed(name)]
    if missing:
        sys.exit(
            f"error: {', '.join(missing)} not installed here: make bench-peers makes the environment for it"
        )
    subprocess.run(
        [sys.executable, "-m", "benchmarks.peers.check"], cwd=ROOT, check=True, stdout=sys.stderr
    )
    figures = measure(options.rounds, options.seconds, options.pause)
    print(table(figures))
    if options.json:
        options.json.write_text(json.dumps(record(figures, options), indent=2) + "\n")


def measure(rounds: int, seconds: float, pause: bool) -> dict[str, dict[str, Any]]:
    """Rates of every round, seconds until the first call was done, and peak memory, by part."""
    figures: dict[str, dict[str, Any]] = {}
    with ExitStack() as alive:
        peers = {}
        for name, part in PARTS.items():
            print(f"starting {part.title}", file=sys.stderr)
            peers[name] = alive.enter_context(Peer(name, part.module, *part.arguments))
            figures[name] = {**peers[name].first, "steps_per_second": [], "other_cores": []}
        if pause:
            input("all are ready; Enter begins the measurement: ")
        for turn in range(rounds):
            for name, peer in peers.items():
                answer = peer.ask(seconds)
                figures[name]["steps_per_second"].append(answer["steps_per_second"])
                figures[name]["other_cores"].append(answer["other_cores"])
                figures[name]["peak_mib"] = answer["peak_mib"]
            print(f"round {turn + 1} of {rounds}", file=sys.stderr)
    for name, part in PARTS.items():
        if part.against:
            figures[name]["ours_over_it"] = over(figures, part.against, name)
        if part.against == "ours":
            figures[name]["two_seeds_over_it"] = over(figures, "two-seeds", name)
    return figures


def over(figures: dict[str, dict[str, Any]], ours: str, peer: str) -> float:
    """Median over the rounds of one rate over the other in the same round."""
    rates, others = figures[ours]["steps_per_second"], figures[peer]["steps_per_second"]
    return statistics.median(
        rates[turn] / others[turn] for turn in undisturbed(figures, ours, peer)
    )


def undisturbed(figures: dict[str, dict[str, Any]], *names: str) -> list[int]:
    """The rounds in which these parts had the machine to themselves; all rounds where those are too
    few.
    """
    rounds = range(len(figures[names[0]]["other_cores"]))
    alone = [
        turn
        for turn in rounds
        if all((figures[name]["other_cores"][turn] or 0.0) <= DISTURBED for name in names)
    ]
    return alone if len(alone) >= ENOUGH else list(rounds)


def table(figures: dict[str, dict[str, Any]]) -> str:
    """The Markdown table and a line on the target."""
    rows = [
        "| | learners | environment steps/s, median (least to most) | ours over it | ours, two seeds, over it | peak MiB | bursts counted |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, part in PARTS.items():
        row, turns = figures[name], undisturbed(figures, name)
        rates = sorted(row["steps_per_second"][turn] for turn in turns)
        rate = f"{statistics.median(rates):,.0f} ({rates[0]:,.0f} to {rates[-1]:,.0f})"
        ratios = [
            f"{row[key]:.2f}" if key in row else "" for key in ("ours_over_it", "two_seeds_over_it")
        ]
        rows.append(
            f"| {part.title} | {part.learners} | {rate} | {' | '.join(ratios)} | {row['peak_mib']:,.0f} | {len(turns)} of {len(row['other_cores'])} |"
        )
    met = [
        part.title
        for name, part in PARTS.items()
        if figures[name].get("ours_over_it", 0.0) >= TARGET
    ]
    rows.append(
        f"\nAt least {TARGET:g} times as fast, same work, as: {'; '.join(met) or 'none of them'}."
    )
    return "\n".join(rows)


def record(figures: dict[str, dict[str, Any]], options: argparse.Namespace) -> dict[str, Any]:
    """What belongs into the file: figures, machine, versions and how it was measured."""
    packages = ("jax", "jaxlib", "mujoco", "mujoco-mjx", "brax", "torch", "skrl", "numpy")
    return {
        "parts": figures,
        "rounds": options.rounds,
        "seconds": options.seconds,
        "machine": backend.machine(),
        "versions": {
            "python": platform.python_version(),
            **{name: metadata.version(name) for name in packages},
        },
    }


def installed(package: str) -> bool:
    """Whether a package is there."""
    try:
        metadata.version(package)
    except metadata.PackageNotFoundError:
        return False
    return True


if __name__ == "__main__":
    main()
