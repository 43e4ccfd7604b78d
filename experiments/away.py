"""A study's final defenders against attackers that they never met: all its runs in one tournament.

    python experiments/away.py experiments/studies/ablation.toml
    python experiments/away.py experiments/studies/ablation.toml --table --reference ippo

Takes the runs that `experiments/variants.py` has trained here. All fly the game of the study's first
variant. Every run's final defender meets every tenth and the final attacker of all runs, and the
scripted attackers; its away score is its mean score against them, its own run's left out
(`analysis.panel`). And every run's defenders meet its own attackers, all chunks, for the Elo rating
that the paper gives the final one. What a run came to is kept beside the study file, as
studies/STUDY_away.jsonl. The tournament goes on where it stopped.

`--table` flies nothing and prints the table of what is kept. Differences are to `--reference`,
by default the first variant; intervals are Welch's, of each difference alone.
"""

import json
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import variants
from kept import read_lines
from measured import markdown_row, spread
from study_tournament import flown, own_ratings, study_flags

from dronecombat_jax.analysis.compare import welch
from dronecombat_jax.analysis.panel import EVERY, away_panel, cross_play_cells
from dronecombat_jax.analysis.result import TournamentResult, by_training
from dronecombat_jax.files.atomic import write_atomic

ANCHORS = "scripted:all"


def kept_of(study: Path) -> Path:
    """Where what was counted of a study is kept."""
    return study.with_name(f"{study.stem}_away.jsonl")


def counted(result: TournamentResult, runs: dict[str, tuple[str, int]]) -> list[dict[str, Any]]:
    """Each run's away score and the Elo of its final defender in its own pool; `runs`: variant and
    seed by `Entrant.lineage`. A run that did not play what its numbers need is left out.
    """
    panel = away_panel(result)
    rated = own_ratings(result)
    finals = {run: saved[-1][0] for run, saved in by_training(result.defenders).items()}
    lines = []
    for run, score, fights in zip(panel.runs, panel.adjusted, panel.fights, strict=True):
        variant, seed = runs[run]
        if run in rated and np.isfinite([score, rated[run][finals[run]]]).all():
            elo = float(rated[run][finals[run]])
            lines.append(
                {
                    "variant": variant,
                    "seed": seed,
                    "score": float(score),
                    "fights": int(fights),
                    "own_elo": elo,
                }
            )
    return lines


def table(study: variants.Study, lines: Sequence[dict[str, Any]], reference: str) -> str:
    """Markdown: a row for each variant with its away score and its Elo, and how they differ from
    the variant `reference`.
    """
    heads = ["variant", "seeds", "away score", f"minus `{reference}`"]
    heads += ["Elo in its own pool", f"minus `{reference}`"]
    rows = [markdown_row(heads), markdown_row(["---"] * len(heads))]
    of = lambda name, key: [line[key] for line in lines if line["variant"] == name]
    for variant in study.variants:
        seeds = len(of(variant.name, "seed"))
        about = f": {variant.about}" if variant.about else ""
        cells = [f"`{variant.name}`{about}", str(seeds or "not flown")]
        for key, digits in (("score", 3), ("own_elo", 0)) if seeds else ():
            values, others = of(variant.name, key), of(reference, key)
            cells += [spread(values, digits)]
            cells += ["" if variant.name == reference else _minus(values, others, digits)]
        rows.append(markdown_row(cells + [""] * (len(heads) - len(cells))))
    return "\n".join(rows)


def _minus(values: Sequence[float], others: Sequence[float], digits: int) -> str:
    if not others:
        return ""
    found = welch(np.asarray(values), np.asarray(others))
    shown = f"{found.difference:+.{digits}f}"
    if np.isnan(found.low):
        return shown
    return f"{shown} ({found.low:+.{digits}f} to {found.high:+.{digits}f})"


def fly(study: variants.Study, root: Path, fights: int, tournaments: Path) -> list[dict[str, Any]]:
    """The tournament of all runs of the study that are whole, and what each came to. SystemExit,
    one line, where there are none and for what cannot be flown.
    """
    folders = variants.whole(study, root)
    if not folders:
        raise SystemExit(f"{root}: no finished run of the study {study.name}")
    result = flown(
        [*map(str, folders.values()), ANCHORS],
        tournaments / study.name,
        fights,
        cells=partial(cross_play_cells, every=EVERY),
        allow_mismatch=True,
    )
    return counted(result, {f"{folder.name}#{run[1]}": run for run, folder in folders.items()})


def main() -> int:
    """Fly, keep, print the table."""
    parser = study_flags(__doc__, 20)
    parser.add_argument("--reference", help="the variant that all others are compared with")
    flags = parser.parse_args()
    study = variants.read_study(flags.study)
    names = [variant.name for variant in study.variants]
    reference = flags.reference or names[0]
    if reference not in names:
        parser.error(f"--reference {reference}: no such variant ({', '.join(names)})")
    path = kept_of(flags.study)
    if flags.table:
        lines = read_lines(path)
    else:
        lines = fly(study, flags.runs / study.name, flags.fights, flags.tournaments)
        write_atomic(path, "".join(json.dumps(line) + "\n" for line in lines))
    print(table(study, lines, reference))
    return 0


if __name__ == "__main__":
    sys.exit(main())
