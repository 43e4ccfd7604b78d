"""Small multiples of how fights end over training, and a table of the last tenth, one row a run.

    python experiments/learnability.py runs/duel-0 runs/duel-1="no head start" --out
    docs/learnability.png

A label may follow a run's folder after "="; `--by-seed` tells its seeds apart. The table goes to
stdout as Markdown; docs/learnability.md shows both.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import measured
from panels import in_panels

from dronecombat_jax.errors import UserError
from dronecombat_jax.files import metrics
from dronecombat_jax.report.figures import OUTCOMES, ROLE_COLOURS
from dronecombat_jax.types import SIDES

# isort: split
# After the report, which imports Matplotlib whatever MPLBACKEND names.
from matplotlib.axes import Axes

BINS = 80
SHOWN = ("intercept", "attacker_crash", "timeout", "both_crash", "defender_crash", "reached")


class Shares(NamedTuple):
    """How the fights of a run ended, by bins of iterations."""

    label: str
    steps: np.ndarray  # [K] environment steps at each bin's end, in millions
    outcomes: np.ndarray  # [len(SHOWN), K] shares of ended fights
    crashes: np.ndarray  # [2, K] share of ended fights in which that drone had gone down


def main() -> None:
    """Read the flags, print the table, draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("runs", nargs="+", help="a run's folder, or folder=label")
    parser.add_argument("--by-seed", action="store_true", help="a row and a panel for each seed")
    parser.add_argument("--out", type=Path, help="a PNG to draw into")
    flags = parser.parse_args()
    pairs = [word.partition("=") for word in flags.runs]
    runs = [(Path(folder), label or Path(folder).name) for folder, _, label in pairs]
    try:
        read = [(label, metrics.read(folder / "metrics.jsonl")) for folder, label in runs]
    except UserError as error:
        parser.exit(error.exit_code, f"error: {error.message}\n")
    if flags.by_seed:
        read = [
            (f"{label}/{seed}", part) for label, records in read for seed, part in by_seed(records)
        ]
    print(
        "| run | steps | both fight from | intercepted | target reached | time-out | defender crashed | attacker crashed | fight |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for label, records in read:
        print(last_tenth(label, records))
    if flags.out:
        draw([binned(label, records) for label, records in read], flags.out)


def by_seed(records: Sequence[dict[str, Any]]) -> list[tuple[int, list[dict[str, Any]]]]:
    """The records of each seed."""
    seeds = sorted({record["seed"] for record in records})
    return [(seed, [record for record in records if record["seed"] == seed]) for seed in seeds]


def last_tenth(label: str, records: Sequence[dict[str, Any]]) -> str:
    """One row of the table: from when both sides fight, and shares of the fights that ended in the last
    tenth of the steps, all seeds together.
    """
    end = records[-1]["steps"]
    late = [record for record in records if record["steps"] > 0.9 * end]
    names = (
        "outcome/intercept",
        "outcome/reached",
        "outcome/timeout",
        "crash/defender",
        "crash/attacker",
    )
    shares = " | ".join(f"{measured.mean(late, name):.2f}" for name in names)
    since = measured.fights_from(records)
    begins = "never" if since is None else f"{since / 1e6:.0f} M"
    return f"| {label} | {end / 1e6:.1f} M | {begins} | {shares} | {measured.mean(late, 'episode_steps'):.0f} steps |"


def binned(label: str, records: Sequence[dict[str, Any]]) -> Shares:
    """The curves of one run, in `BINS` bins or one for each iteration."""
    groups = np.array_split(np.arange(len(records)), min(BINS, len(records)))
    chosen = [[records[i] for i in group] for group in groups]
    curve = lambda key: [measured.mean(group, key) for group in chosen]
    return Shares(
        label,
        np.array([group[-1]["steps"] / 1e6 for group in chosen]),
        np.array([curve(f"outcome/{name}") for name in SHOWN]),
        np.array([curve(f"crash/{role}") for role in SIDES]),
    )


def draw(runs: Sequence[Shares], path: Path) -> None:
    """One panel a run: how fights end, stacked; the share of fights in which each drone went down,
    dashed.
    """
    figure = in_panels([run.label for run in runs], lambda ax, number: _draw(ax, runs[number]))
    figure.savefig(path, dpi=110)


def _draw(ax: Axes, run: Shares) -> None:
    colours = [OUTCOMES[name][1] for name in SHOWN]
    ax.stackplot(
        run.steps,
        run.outcomes,
        colors=colours,
        linewidth=0,
        labels=[OUTCOMES[name][0] for name in SHOWN],
    )
    for role, curve in zip(SIDES, run.crashes, strict=True):
        ax.plot(run.steps, curve, color="black", linewidth=2.2)
        ax.plot(
            run.steps, curve, color=ROLE_COLOURS[role], linewidth=1.2, label=f"{role} goes down"
        )
    ax.set_xlim(0.0, run.steps[-1])


if __name__ == "__main__":
    main()
