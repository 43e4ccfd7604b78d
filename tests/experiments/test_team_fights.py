"""What is counted of fights between teams, who meets whom, and the tables."""

import json
import sys

import numpy as np
import pytest
import team_fights
import variants

from dronecombat_jax.types import Cause


def planted() -> team_fights.Fights:
    """Two fights of two defenders and two attackers, four steps of 0.5 s.

    In the first the second defender takes out the first attacker in step 2 and the other in step 4;
    in the second the mates come within a hand of each other and the attackers reach their goal in
    step 2, after the first defender has crashed in step 2.
    """
    at = lambda *x: np.array([[x, 0.0, 1.0] for x in x], np.float32)
    apart = [at(0, 5, 9, 6), at(0, 6, 9, 6), at(0, 8.9, 9, 6), at(0, 7, 9, 6), at(0, 6.1, 9, 6)]
    close = [at(0, 0.05, 3, 8), at(0, 1, 3, 8), at(0, 1, 2, 8), at(0, 1, 2, 8), at(0, 1, 2, 8)]
    position = np.stack([np.stack(apart), np.stack(close)], axis=1)
    crashed, struck = np.zeros((5, 2, 4), bool), np.zeros((5, 2, 4), bool)
    struck[2:, 0, 2], struck[4:, 0, 3], crashed[2:, 1, 0] = True, True, True
    cause = np.array([Cause.INTERCEPT, Cause.REACHED])
    return team_fights.Fights(position, crashed, struck, cause, np.array([4, 2]), 2, 0.5)


def test_what_is_counted():
    counts = team_fights.counted(planted())
    assert (counts["intercepted"], counts["reached"], counts["fights"]) == (0.5, 0.5, 2)
    assert (counts["defenders_crashed"], counts["attackers_crashed"]) == (0.25, 0.0)
    assert counts["mates_touched"] == 0.5
    assert counts["seconds"] == 2.0 and counts["rho"] == 0.0  # the last step, and never
    assert counts["busiest"] == 1.0 and counts["by_nearest"] == 1.0
    assert counts["mate_away"] == 7.5  # 9 m and 6 m: the first one stays where it is


def test_the_work_is_shared_by_whom_it_was_nearest_to():
    fights = planted()
    assert team_fights.strikes_of(fights) == [(1, True, 9.0), (1, True, 6.0)]
    fights.position[0, 0, 0, 0] = 6.9  # nearest to both at the start
    assert team_fights.strikes_of(fights) == [(1, False, 9.0), (1, False, 6.0)]
    fights.crashed[2:, 0, 0] = True  # by the second strike nobody else flies
    assert team_fights.strikes_of(fights)[1] == (1, False, np.inf)
    fights = planted()
    # The first fight counts until its first strike: all four fly in steps 0 and 1, the defenders
    # nearest to the same attacker. In the second both defenders mind the attacker that is near.
    assert team_fights.divided(fights) == 0.0
    fights.position[:2, 0, 0, 0] = 9.5  # in two of the four steps somebody is at either attacker
    assert team_fights.divided(fights) == 0.5


def test_a_run_meets_no_attacker_of_its_own_seed():
    runs = [
        f"{method}-{size}/{seed}"
        for method in ("ippo", "mappo")
        for size in ("2v2", "3v2")
        for seed in (0, 1)
    ]
    pairs = team_fights.pairs_of(runs)
    of = lambda size, who: {p.attacker for p in pairs if p.size == size and p.defender == who}
    assert of((2, 2), "ippo-2v2/0") == {"ippo-2v2/1", "mappo-2v2/1", *team_fights.ATTACKERS}
    assert of((4, 2), "mappo-3v2/1") == {"ippo-3v2/0", "mappo-3v2/0", *team_fights.ATTACKERS}
    assert len(of((3, 2), "assigned_navigation")) == 4 + len(team_fights.ATTACKERS)
    assert len({pair.key for pair in pairs}) == len(pairs)


def test_the_tables_have_a_mean_over_seeds_and_its_interval():
    counts = team_fights.counted(planted())
    lines = [
        {"size": "2v2", "defender": f"ippo-2v2/{seed}", "attacker": "ippo-2v2/9", **counts, "intercepted": share}
        for seed, share in enumerate((0.4, 0.5, 0.6))
    ]  # fmt: skip
    text = team_fights.tables(lines)
    # a standard error of 0.1 / sqrt(3) by a t of 4.303 with two degrees of freedom
    assert "| 2v2 | 50 ± 25 |  |  |  |" in text and "| 4v2 (unseen) |" in text
    against = [line | {"attacker": "pincer", "intercepted": 0.25} for line in lines[:1]]
    pincer, decoy = team_fights.tables([*lines, *against]).split("`pincer`:")[1].split("`decoy`:")
    assert "| 2v2 | 25 |  |  |  |" in pincer and "| 2v2 |  |  |  |  |" in decoy


@pytest.mark.slow
def test_scripted_teams_of_every_size_and_runs_that_are_there(tmp_path, monkeypatch, capsys):
    """The whole command, on two seeds trained for a moment."""
    study = variants.read_study(team_fights.STUDY)
    root = tmp_path / "teams"
    for variant in study.variants:
        if variant.name != "ippo-3v2":
            continue
        for seed in (0, 1):
            small = {"train.num_envs": 60, "learn.rollout_steps": 4, "train.chunk_iterations": 2}
            brief = variant._replace(steps=960, settings=variant.settings | small)
            root.mkdir(exist_ok=True)
            assert variants._train(brief, seed, root, 0) == 0
    monkeypatch.setattr(team_fights, "KEPT", tmp_path / "kept.jsonl")
    monkeypatch.setattr(sys, "argv", ["team_fights.py", "--runs", str(root), "--fights", "4"])
    assert team_fights.main() == 0
    kept = (tmp_path / "kept.jsonl").read_text()
    lines = [json.loads(line) for line in kept.splitlines()]
    assert {line["size"] for line in lines} == {"1v1", "2v1", "2v2", "3v2", "4v2"}
    assert len([line for line in lines if line["defender"] == "ippo-3v2/0"]) == 2 * (1 + 4)
    assert "| 4v2 (unseen) |" in capsys.readouterr().out
    assert team_fights.main() == 0  # nothing is flown twice
    assert (tmp_path / "kept.jsonl").read_text() == kept
