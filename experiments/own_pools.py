"""What the paper shows, in each run of a study: its own defenders against its own attackers.

    python experiments/own_pools.py experiments/studies/readings.toml
    python experiments/own_pools.py experiments/studies/readings.toml --table

Takes the runs that `experiments/variants.py` has trained here. Of each, every checkpoint's defender
meets every checkpoint's attacker, in that run's own game; rated and measured as the report does it
(`analysis.claim_measures`). The paper shows three things, for which this table has bars:

- attackers rate above defenders (figure 4): the mean Elo of one less that of the other is above 0;
- defenders win 0.25 to 0.45 of their fights (figure 6): so does the mean of the whole map;
- their win rate declines late (figure 6): by 0.05 or more.

What a run came to is kept beside the study file, as studies/STUDY_own.jsonl. `--table` flies nothing
and prints the table of what is kept.
"""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import variants
from kept import read_lines
from measured import markdown_row, spread
from study_tournament import flown, study_flags

from dronecombat_jax.analysis import claim_measures
from dronecombat_jax.analysis.result import TournamentResult, first_episodes, win_rate
from dronecombat_jax.analysis.study import ELO_EPISODES, Effort, own_elo
from dronecombat_jax.files.atomic import write_atomic

WIN_RATES = (0.25, 0.45)  # the paper's
DECLINE = 0.05


def counted(result: TournamentResult) -> dict[str, float]:
    """The three numbers of one run's own tournament."""
    method = result.defenders[-1].method
    rated = own_elo(
        first_episodes(result, min(ELO_EPISODES, result.cause.shape[2])), Effort().orders
    )
    (own,) = claim_measures.own_maps(result, method)
    (ahead,) = claim_measures.attackers_ahead(result, rated, method)
    (decline,) = claim_measures.late_decline(result, method)
    return {
        "attackers_ahead": float(ahead),
        "win_rate": float(win_rate(own.part).mean()),
        "decline": float(decline),
    }


def shows(line: dict[str, Any]) -> tuple[bool, bool, bool]:
    """Which of the three things that the paper shows are there."""
    low, high = WIN_RATES
    return (
        line["attackers_ahead"] > 0.0,
        low <= line["win_rate"] <= high,
        line["decline"] >= DECLINE,
    )


def table(study: variants.Study, lines: Sequence[dict[str, Any]]) -> str:
    """Markdown: a row for each variant."""
    heads = ["variant", "seeds", "attackers minus defenders, Elo", "defenders' win rate"]
    heads += ["late decline", "of the paper's three, by seed"]
    rows = [markdown_row(heads), markdown_row(["---"] * len(heads))]
    for variant in study.variants:
        own = [line for line in lines if line["variant"] == variant.name]
        about = f": {variant.about}" if variant.about else ""
        cells = [f"`{variant.name}`{about}", str(len(own) or "not flown")]
        if own:
            cells += [
                spread([line[key] for line in own], digits)
                for key, digits in (("attackers_ahead", 0), ("win_rate", 2), ("decline", 2))
            ]
            cells += [", ".join(str(sum(shows(line))) for line in own)]
        rows.append(markdown_row(cells + [""] * (len(heads) - len(cells))))
    return "\n".join(rows)


def main() -> int:
    """Fly what is missing, keep it, print the table."""
    flags = study_flags(__doc__, 10).parse_args()
    study = variants.read_study(flags.study)
    path = flags.study.with_name(f"{study.name}_own.jsonl")
    lines = {(line["variant"], line["seed"]): line for line in read_lines(path)}
    for run, folder in (
        {} if flags.table else variants.whole(study, flags.runs / study.name).items()
    ):
        if run in lines:
            continue
        place = flags.tournaments / f"{study.name}-{folder.name}"
        numbers = counted(flown([str(folder)], place, flags.fights))
        lines[run] = {"variant": run[0], "seed": run[1], **numbers}
        write_atomic(path, "".join(json.dumps(lines[key]) + "\n" for key in sorted(lines)))
    print(table(study, [lines[key] for key in sorted(lines)]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
