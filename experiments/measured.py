"""What a training has come to, as figures: how its fights end, from when on both sides fight, and how
both final policies fare from rest against every scripted pilot of today.

    python experiments/measured.py runs/ippo runs/seed1 ...

prints a table, one row for each finished run of one seed. `experiments/variants.py` has the same
figures; those of a run are kept in its measured.json. Bars: those of docs/learnability.md.
"""

import argparse
import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from dronecombat_jax.errors import UserError
from dronecombat_jax.files import metrics

DEFENDERS = ("hover", "pure_pursuit", "hover_guard", "proportional_navigation")
ATTACKERS = ("dash", "weave", "high_dive")
FIGHTS = 256  # against each pilot
WINDOW = 1_000_000  # steps over which the bars must hold
NAMES = {
    "intercepted": "outcome/intercept",
    "reached": "outcome/reached",
    "timeout": "outcome/timeout",
    "defender down": "crash/defender",
    "attacker down": "crash/attacker",
}


def of(run: Path, steps: int) -> dict[str, Any] | None:
    """The measures of a run; None where it is not whole. Flies the fights where they are not known."""
    records = _records(run)
    if not records or records[-1]["steps"] < steps:
        return None
    file = run / "measured.json"
    if file.exists():
        known = json.loads(file.read_text())
        if known["steps"] == records[-1]["steps"]:  # not measured before it went on
            return known
    late = [record for record in records if record["steps"] > 0.9 * records[-1]["steps"]]
    shares = {name: mean(late, key) for name, key in NAMES.items()}
    numbers = {
        "steps": records[-1]["steps"],
        "shares": shares,
        "fights": fights(shares),
        "fights_from": fights_from(records),
        "curve": curve(records),
        "against": against(run),
    }
    file.write_text(json.dumps(numbers, indent=1) + "\n")
    return numbers


def fights(shares: dict[str, float]) -> bool:
    """Whether both sides fight: all bars hold."""
    return (
        shares["intercepted"] >= 0.1
        and shares["reached"] >= 0.1
        and shares["intercepted"] + shares["reached"] >= 0.75
        and shares["defender down"] < 0.2
        and shares["attacker down"] < 0.2
    )


def fights_from(records: Sequence[dict[str, Any]]) -> int | None:
    """Environment steps at the end of the first window of `WINDOW` steps in which all bars hold; None:
    never.
    """
    for number, shares in enumerate(_windows(records), start=1):
        if fights(shares):
            return number * WINDOW
    return None


def curve(records: Sequence[dict[str, Any]]) -> list[dict[str, float | None]]:
    """How fights ended in each `WINDOW` of steps, from the first one on: shares by the keys of `NAMES`;
    None where no fight ended.
    """
    rounded = lambda share: None if math.isnan(share) else round(share, 4)
    return [{name: rounded(share) for name, share in each.items()} for each in _windows(records)]


def _windows(records: Sequence[dict[str, Any]]) -> list[dict[str, float]]:
    """The shares in each `WINDOW` of steps; NaN where no fight ended."""
    windows: dict[int, list[dict[str, Any]]] = {}
    for record in records:
        windows.setdefault((record["steps"] - 1) // WINDOW, []).append(record)
    return [
        {name: mean(windows.get(window, []), key) for name, key in NAMES.items()}
        for window in range(max(windows, default=-1) + 1)
    ]


def against(run: Path) -> dict[str, float]:
    """Share of `FIGHTS` fights from rest, mean actions, that the final policies win against each
    scripted pilot: the attacker past defenders, the defender over attackers.
    """
    from dronecombat_jax.machine import backend

    backend.prepare("cpu")
    from dronecombat_jax.combat.rules import outcome_table
    from dronecombat_jax.runs.evaluation import Match, load_run, play
    from dronecombat_jax.types import Outcome

    saved = load_run(run)
    winner = np.asarray(outcome_table(saved.config.game))

    def won(side: Outcome, match: Match) -> float:
        return float(np.mean(winner[play(saved, 0, match).cause] == side))

    past = {name: won(Outcome.ATTACKER, Match(FIGHTS, defender=name)) for name in DEFENDERS}
    return past | {name: won(Outcome.DEFENDER, Match(FIGHTS, attacker=name)) for name in ATTACKERS}


def markdown(rows: Sequence[tuple[str, str, list[dict[str, Any]]]]) -> str:
    """Two Markdown tables, how trainings end and how final policies fare; each row a variant's name,
    in the first also what it is, and the measures of its seeds.
    """
    ends = ["variant", "seeds that fight", "from, M steps: median (most)", *NAMES]
    spelt = lambda name: name.replace("_", " ")  # a heading that a page can break
    pilots = [f"stops {spelt(name)}" for name in ATTACKERS]
    pilots += [f"past {spelt(name)}" for name in DEFENDERS]
    first, second = (
        [markdown_row(head), markdown_row(["---"] * len(head))]
        for head in (ends, ["variant", *pilots])
    )
    for name, about, runs in rows:
        cells = [f"`{name}`" + (f": {about}" if about else "")]
        if not runs:
            first.append(markdown_row([*cells, "not run", *[""] * (len(ends) - 2)]))
            continue
        cells += [f"{sum(run['fights'] for run in runs)} of {len(runs)}", _from(runs)]
        first.append(
            markdown_row(
                cells + [spread([run["shares"][share] for run in runs]) for share in NAMES]
            )
        )
        opponents = (*ATTACKERS, *DEFENDERS)
        fares = [spread([run["against"][opponent] for run in runs]) for opponent in opponents]
        second.append(markdown_row([f"`{name}`", *fares]))
    note = (
        "Mean over seeds, ± its 95 % interval by Student's t; in brackets the least and the most. "
        "One seed or two: their own."
    )
    return "\n".join([*first, "", *second, "", note])


def mean(records: Sequence[dict[str, Any]], key: str) -> float:
    """Mean of `key` over the fights that ended in `records`; NaN where none did."""
    known = [(record[key], record["episodes"]) for record in records if record[key] is not None]
    total = sum(weight for _, weight in known)
    return sum(value * weight for value, weight in known) / total if total else math.nan


def _from(runs: Sequence[dict[str, Any]]) -> str:
    steps = [math.inf if run["fights_from"] is None else run["fights_from"] / 1e6 for run in runs]
    shown = lambda value: "never" if math.isinf(value) else f"{value:.0f}"
    return f"{shown(float(np.median(steps)))} ({shown(max(steps))})"


def spread(values: Sequence[float], digits: int = 2) -> str:
    """Mean over seeds, ± its 95 % interval by Student's t; in brackets the least and the most. One
    seed's or two seeds' numbers stand there themselves.
    """
    shown = lambda value: f"{value:.{digits}f}"
    if len(values) < 3:
        return ", ".join(map(shown, values))
    mean, half = shown(float(np.mean(values))), shown(half_width(values))
    return f"{mean} ± {half} ({shown(min(values))} to {shown(max(values))})"


def half_width(values: Sequence[float]) -> float:
    """Of the 95 % interval of a mean over two seeds or more, by Student's t."""
    return float(stats.sem(values) * stats.t.ppf(0.975, len(values) - 1))


def markdown_row(cells: Iterable[str]) -> str:
    """A line of a Markdown table."""
    return "| " + " | ".join(cells) + " |"


def _records(run: Path) -> list[dict[str, Any]]:
    try:
        return metrics.read(run / "metrics.jsonl")
    except (UserError, OSError):
        return []


def row(run: Path) -> str:
    """A run's figures as one line of Markdown. SystemExit where it is not finished."""
    numbers = of(run, 1)
    try:
        evaluation = json.loads((run / "evaluation.json").read_text())
    except (OSError, ValueError):
        evaluation = None
    if numbers is None or evaluation is None:
        raise SystemExit(f"{run}: no finished run: metrics.jsonl or evaluation.json is missing")
    if len(evaluation) > 1:
        raise SystemExit(f"{run}: {len(evaluation)} seeds: only runs of one seed are shown")
    pairs = lambda names: ", ".join(f"{numbers['against'][name]:.2f}" for name in names)
    rest = [evaluation[0]["cause"][cause][0] for cause in ("intercept", "reached")]
    cells = [run.name, _from([numbers]).partition(" ")[0]]
    cells += [f"{numbers['shares'][name]:.2f}" for name in NAMES]
    cells += [pairs(DEFENDERS[:2]), pairs(ATTACKERS), pairs(DEFENDERS[2:])]
    return markdown_row([*cells, ", ".join(f"{share:.2f}" for share in rest)])


def main() -> None:
    """Read the runs' folders, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("runs", nargs="+", type=Path, help="folders of finished runs of one seed")
    listed = lambda names: ", ".join(f"`{name}`" for name in names)
    head = ["run", "fights from, M steps", *NAMES, f"past {listed(DEFENDERS[:2])}"]
    head += [f"stops {listed(ATTACKERS)}", f"past {listed(DEFENDERS[2:])}"]
    head.append("each other at rest: intercepted, reached")
    rows = [row(run) for run in parser.parse_args().runs]
    print("\n".join([markdown_row(head), markdown_row(["---"] * len(head)), *rows]))


if __name__ == "__main__":
    main()
