"""What the paper shows, in each run of a study: its own defenders against its own attackers.

    python experiments/own_pools.py experiments/studies/readings.toml
    python experiments/own_pools.py experiments/studies/readings.toml --table

Takes the runs that `experiments/variants.py` has trained here. Of each, every checkpoint's defender
meets every checkpoint's attacker, in that run's own game; rated and measured as the report does it
(`analysis.claim_measures`). The paper shows three things, for which this table has bars:

- attackers rate above defenders (figure 4): the mean Elo of one less that of the other is above 0;
- defenders win 0.25 to 0.45 of their fights (figure 6): so does the mean of the whole map;
- their win rate declines late (figure 6): by 0.05 or more.

What a run came to is kept beside the study file (`kept`), as studies/STUDY_own.jsonl, and counts
while its variant has the same settings. `--table` flies nothing and prints the table of what is kept.
"""

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import variants
from kept import Kept
from measured import markdown_row, spread
from study_tournament import flown, own_ratings, study_flags

from dronecombat_jax.analysis import claim_measures
from dronecombat_jax.analysis.result import TournamentResult, win_rate

WIN_RATES = (0.25, 0.45)  # the paper's
DECLINE = 0.05


def counted(result: TournamentResult) -> dict[str, float]:
    """The three numbers of one run's own tournament."""
    method = result.defenders[-1].method
    rated = own_ratings(result)
    (own,) = claim_measures.own_maps(result, method)
    (ahead,) = claim_measures.attackers_ahead(result, rated, method)
    (decline,) = claim_measures.late_decline(result, method)
    return {
        "attackers_ahead": float(ahead),
        "win_rate": float(win_rate(own.part).mean()),
        "decline": float(decline),
    }


def shows(run: dict[str, Any]) -> tuple[bool, bool, bool]:
    """Which of the three things that the paper shows are there."""
    low, high = WIN_RATES
    return (
        run["attackers_ahead"] > 0.0,
        low <= run["win_rate"] <= high,
        run["decline"] >= DECLINE,
    )


def table(study: variants.Study, kept: Kept) -> str:
    """Markdown: a row for each variant."""
    heads = ["variant", "seeds", "attackers minus defenders, Elo", "defenders' win rate"]
    heads += ["late decline", "of the paper's three, by seed"]
    rows = [markdown_row(heads), markdown_row(["---"] * len(heads))]
    for variant in study.variants:
        found = [kept.find(variant.name, seed, variant.changed) for seed in variant.seeds]
        own = [run for run in found if run is not None]
        about = f": {variant.about}" if variant.about else ""
        cells = [f"`{variant.name}`{about}", str(len(own) or "not flown")]
        if own:
            cells += [
                spread([run[key] for run in own], digits)
                for key, digits in (("attackers_ahead", 0), ("win_rate", 2), ("decline", 2))
            ]
            cells += [", ".join(str(sum(shows(run))) for run in own)]
        rows.append(markdown_row(cells + [""] * (len(heads) - len(cells))))
    return "\n".join(rows)


def main() -> int:
    """Fly what is missing, keep it, print the table."""
    flags = study_flags(__doc__, 10).parse_args()
    study = variants.read_study(flags.study)
    kept, by_name = Kept(flags.study, "own"), {one.name: one for one in study.variants}
    trained = {} if flags.table else variants.whole(study, flags.runs / study.name)
    for (name, seed), folder in trained.items():
        settings = by_name[name].changed
        if kept.find(name, seed, settings) is None:
            place = flags.tournaments / f"{study.name}-{folder.name}"
            numbers = counted(flown([str(folder)], place, flags.fights))
            kept.keep(name, seed, settings, numbers)
    print(table(study, kept))
    return 0


if __name__ == "__main__":
    sys.exit(main())
