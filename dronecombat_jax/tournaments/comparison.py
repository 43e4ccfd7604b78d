"""`dronecombat compare`: does one method's final defender beat another's, from one tournament of
all runs.
"""

from collections.abc import Sequence
from pathlib import Path

from dronecombat_jax.analysis.panel import EVERY, cells_needed
from dronecombat_jax.analysis.result import TournamentResult
from dronecombat_jax.analysis.verdict import judge
from dronecombat_jax.analysis.verdict_text import verdict_json, verdict_text
from dronecombat_jax.arena.rectangle import Rules
from dronecombat_jax.config.starts import AS_TRAINED
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_TOURNAMENT, UserError
from dronecombat_jax.files.atomic import write_atomic
from dronecombat_jax.files.plain import to_json
from dronecombat_jax.files.rundir import find_run, run_path
from dronecombat_jax.tournaments import tournament as tournaments
from dronecombat_jax.tournaments.grouping import (
    as_compared,
    group,
    other_differences,
    read_configs,
    regroup,
)
from dronecombat_jax.tournaments.result_file import find_tournament, load_about, load_result

ANCHORS = "scripted:all"
ENOUGH = 500  # fights behind one seed's score


def compare(
    runs: Sequence[str],
    rules: Rules,
    *,
    by: str = "method",
    name: str = "",
    every: int = EVERY,
    spawn: str = AS_TRAINED,
    skip_bad: bool = False,
    allow_mismatch: bool = False,
    root: str = "tournaments",
) -> int:
    """Fly, or go on with, the cross-play of all `runs` and the scripted pilots, and judge it;
    returns an exit code.

    Only the cells that the answer and its report rest on are flown (`panel.cells_needed`); `every`:
    which attackers of a run are on the panel beside its final one; `spawn`: where fights start
    (`config.starts`). Without `runs` the tournament
    `name` is judged as it lies there, as it was compared before or by the methods that it names.
    UserError 2 for a grouping that leaves nothing to compare, before anything is flown.
    """
    if not runs:
        if not name or by != "method":
            raise UserError(
                "which runs? dronecombat compare RUN RUN ..., or --tournament NAME alone",
                EXIT_CONFIG,
            )
        path = find_tournament(name, root)
        result, about = as_compared(load_result(path), load_about(path))
        return _judge(result, path, about.by, about.every, [])
    paths = [find_run(word) for word in dict.fromkeys(runs)]
    configs = read_configs(paths)
    groups = group(configs, by)
    if len(set(groups.values())) < 2:
        raise UserError(
            f"nothing to compare: all runs are of {next(iter(groups.values()))}; see --by",
            EXIT_CONFIG,
        )
    name = name or f"compare-{tournaments.default_name(runs, spawn)}"[:100]
    words = [*map(str, paths), ANCHORS]
    options = {
        "name": name,
        "every": every,
        "spawn": spawn,
        "skip_bad": skip_bad,
        "allow_mismatch": allow_mismatch,
        "root": root,
    }
    about = {"by": by, "methods": groups, "panel_every": every}
    code = tournaments.tournament(words, rules, **options, cells=cells_needed, about=about)
    if code not in (0, EXIT_TOURNAMENT):
        return code
    folder = run_path(root, name)
    differ = other_differences(configs, by)
    notes = (
        [f"the runs differ in more than {by}: {', '.join(differ)}; any of it may be the cause"]
        if differ
        else []
    )
    _judge(regroup(load_result(folder), groups), folder, by, every, notes)
    print(f"figures and tables of this tournament: dronecombat report {name}")
    return code


def write_comparison(
    result: TournamentResult, folder: Path, by: str, every: int = EVERY, notes: Sequence[str] = ()
) -> str:
    """Judge all pairs of methods, write comparison.json and comparison.txt into `folder`; returns
    the text.
    """
    verdict = judge(result, every=every)
    least = min(int(fights) for fights in verdict.panel.fights)
    few = [f"only {least} fights behind one seed's score: {ENOUGH} are advised, see --episodes"] * (
        least < ENOUGH
    )
    notes = [*notes, *few]
    text = "\n".join([verdict_text(verdict), *(f"note: {note}" for note in notes)])
    write_atomic(
        folder / "comparison.json", to_json({"by": by, **verdict_json(verdict), "notes": notes})
    )
    write_atomic(folder / "comparison.txt", text + "\n")
    return text


def _judge(result: TournamentResult, path: Path, by: str, every: int, notes: Sequence[str]) -> int:
    folder = path if path.is_dir() else path.parent
    print(write_comparison(result, folder, by, every, notes))
    print(f"written to {folder / 'comparison.json'} and comparison.txt")
    return 0
