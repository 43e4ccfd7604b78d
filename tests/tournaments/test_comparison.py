"""The command `compare`: grouping, the one tournament of all runs, and the answer; the fights are
planted.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit
from tournaments import entrants, from_rates

from dronecombat_jax.analysis.panel import cells_needed
from dronecombat_jax.arena.rectangle import Rules
from dronecombat_jax.config import settings
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_STOPPED, UserError
from dronecombat_jax.report import tournament_report
from dronecombat_jax.tournaments import comparison
from dronecombat_jax.tournaments.result_file import save_result

RUNS = {**{f"plain{i}": 0.0 for i in range(4)}, **{f"mixed{i}": 0.2 for i in range(4)}}


@pytest.fixture
def played(monkeypatch, tmp_path):
    """Eight runs on disk, and a tournament in which those with self-play defend better; `played` is
    what was asked.
    """
    monkeypatch.chdir(tmp_path)
    for name, probability in RUNS.items():
        config = settings.load("duel", {"selfplay.probability": probability})
        folder = Path("runs", name)
        folder.mkdir(parents=True)
        text = settings.to_toml(replace(config, run=replace(config.run, name=name)))
        (folder / "config.toml").write_text(text)
    calls = []

    def tournament(words, rules, *, name, root, **options) -> int:
        calls.append((words, rules, name, options))
        sides = [
            [
                one._replace(identity=f"{role}{run}", run=run)
                for one, run in zip(entrants(role, 8, 1), RUNS, strict=True)
            ]
            for role in "da"
        ]
        lift = np.asarray([1.5 * (RUNS[one.run] > 0) + 0.1 * i for i, one in enumerate(sides[0])])
        chance = expit(lift[:, None] + np.zeros(8))
        folder = Path(root, name)
        folder.mkdir(parents=True)
        result = from_rates(chance, rules.episodes, 0, defenders=sides[0], attackers=sides[1])
        save_result(folder, result, dict(options["about"]))
        return 0

    monkeypatch.setattr(comparison.tournaments, "tournament", tournament)
    return calls


def test_all_runs_and_the_pilots_meet_once_and_are_judged(played, capsys):
    assert comparison.compare(list(RUNS), Rules(episodes=100), name="joint") == 0
    ((words, rules, name, options),) = played
    assert words == [*(f"runs/{run}" for run in RUNS), "scripted:all"] and name == "joint"
    assert rules.episodes == 100 and options["every"] == 10 and options["cells"] is cells_needed
    assert (
        options["about"]["panel_every"] == 10 and options["about"]["methods"]["mixed2"] == "s-ippo"
    )
    assert "YES: s-ippo's final defender beats ippo's." in capsys.readouterr().out
    told = json.loads(Path("tournaments/joint/comparison.json").read_text())
    assert told["by"] == "method" and told["comparisons"][0]["exact"] and told["notes"] == []
    assert len(told["seeds"]) == 8


def test_few_fights_and_other_differences_are_noted(played):
    text = settings.to_toml(
        settings.load("duel", {"train.total_steps": 10_000_000, "run.name": "plain0"})
    )
    Path("runs/plain0/config.toml").write_text(text)
    comparison.compare(list(RUNS), Rules(episodes=5), name="joint")
    notes = json.loads(Path("tournaments/joint/comparison.json").read_text())["notes"]
    assert "train.total_steps" in notes[0] and "only 35 fights" in notes[1]


def test_a_report_and_a_second_look_compare_what_was_compared(played, monkeypatch, capsys):
    comparison.compare(
        list(RUNS), Rules(episodes=100), by="selfplay.probability", name="joint", every=3
    )
    first = Path("tournaments/joint/comparison.json").read_text()
    assert comparison.compare([], Rules(), name="joint") == 0
    second = json.loads(Path("tournaments/joint/comparison.json").read_text())
    assert second == json.loads(first) | {"notes": second["notes"]} and second["panel_every"] == 3
    seen = {}
    monkeypatch.setattr(
        tournament_report,
        "write_report",
        lambda result, *_, **how: seen.update(how, result=result) or [Path("x")],
    )
    assert tournament_report.report("joint") == 0
    assert seen["every"] == 3
    assert {one.method for one in seen["result"].defenders} == {
        f"selfplay.probability = {p}" for p in (0.0, 0.2)
    }


def test_a_grouping_that_leaves_nothing_is_refused_before_a_fight(played):
    with pytest.raises(UserError, match="all runs are of ippo") as raised:
        comparison.compare(["plain0", "plain1"], Rules())
    assert raised.value.exit_code == EXIT_CONFIG
    with pytest.raises(UserError, match="which runs"):
        comparison.compare([], Rules())
    assert not played


def test_a_stopped_tournament_is_not_judged(played, monkeypatch):
    monkeypatch.setattr(comparison.tournaments, "tournament", lambda *_, **__: EXIT_STOPPED)
    assert comparison.compare(list(RUNS), Rules(), name="joint") == EXIT_STOPPED
    assert not Path("tournaments/joint").exists()
