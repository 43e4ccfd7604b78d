"""A study's final defenders against attackers that they never met: what is counted, and the table."""

import json
import re
import sys

import away
import numpy as np
import pytest
import variants
from planted_claims import Truth, planted_claims

from dronecombat_jax.analysis.claim_measures import final_own_elo
from dronecombat_jax.analysis.study import Effort, own_elo

STUDY = """
preset = "duel"
steps = 960
seeds = [0, 1]
[variants.default]
about = "as it is"
"train.num_envs" = 60
"learn.rollout_steps" = 4
"train.chunk_iterations" = 2
[variants.ends]
on = "default"
about = "a crash ends the fight"
"game.crash_rule" = "ends"
"learn.learning_rate" = 0.001  # in so few steps nobody crashes, and the policies were the same
[variants.later]
on = "default"
"""


def study_in(folder):
    """A study of two variants, of which one more is not trained."""
    path = folder / "small.toml"
    path.write_text(STUDY)
    return path, variants.read_study(path)


def test_a_seed_has_its_away_score_and_the_elo_that_the_paper_gives_it():
    result = planted_claims(Truth(gap=1.5), seeds=3, episodes=5)
    runs = {
        f"{method}#{seed}": (method, seed) for method in ("ippo", "s-ippo") for seed in range(3)
    }
    lines = away.counted(result, runs)
    assert [(line["variant"], line["seed"]) for line in lines] == sorted(runs.values())
    score = lambda method: np.mean([x["score"] for x in lines if x["variant"] == method])
    assert score("s-ippo") - score("ippo") > 0.2  # planted: 1.5 in log-odds
    rated = own_elo(result, Effort().orders)
    for method in ("ippo", "s-ippo"):
        np.testing.assert_allclose(
            [line["own_elo"] for line in lines if line["variant"] == method],
            final_own_elo(result, rated, method),
        )


def test_a_row_says_how_a_variant_differs_from_the_reference(tmp_path):
    _, study = study_in(tmp_path)
    line = lambda name, seed, score, elo: {
        "variant": name, "seed": seed, "score": score, "fights": 100, "own_elo": elo
    }  # fmt: skip
    lines = [
        *(line("default", seed, score, 1500.0) for seed, score in enumerate((0.4, 0.5, 0.6))),
        *(line("ends", seed, score, 1600.0) for seed, score in enumerate((0.5, 0.6, 0.7))),
    ]
    text = away.table(study, lines, "default")
    # standard errors of 0.1 / sqrt(3): of a mean by a t of 4.303, of a difference by one of 2.776
    assert "| `default`: as it is | 3 | 0.500 ± 0.248 (0.400 to 0.600) |  | 1500" in text
    assert "0.600 ± 0.248 (0.500 to 0.700) | +0.100 (-0.127 to +0.327) | 1600" in text
    assert "| +100 (+100 to +100) |" in text and "| `later` | not flown |" in text
    assert "minus `ends`" in away.table(study, lines, "ends")


def test_what_cannot_be_flown_is_one_line(tmp_path, monkeypatch):
    path, study = study_in(tmp_path)
    with pytest.raises(SystemExit, match="none: no finished run of the study small"):
        away.fly(study, tmp_path / "none", 2, tmp_path)
    monkeypatch.setattr(sys, "argv", ["away.py", str(path), "--reference", "nobody"])
    with pytest.raises(SystemExit) as stopped:
        away.main()
    assert stopped.value.code == 2
    away.kept_of(path).write_text("{")
    monkeypatch.setattr(sys, "argv", ["away.py", str(path), "--table"])
    with pytest.raises(SystemExit, match=r"small_away\.jsonl"):
        away.main()


@pytest.mark.slow
def test_runs_of_two_games_meet_in_the_first_ones(tmp_path, monkeypatch, capsys):
    """The whole command, on runs that were trained for a moment."""
    path, study = study_in(tmp_path)
    root = tmp_path / "runs" / "small"
    root.mkdir(parents=True)
    for variant in study.variants[:2]:
        for seed in variant.seeds:
            assert variants._train(variant, seed, root, 0) == 0
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["away.py", str(path), "--fights", "2"])
    assert away.main() == 0
    table = capsys.readouterr().out
    assert "`ends`: a crash ends the fight | 2 | 0." in table and "| not flown |" in table
    kept = away.kept_of(path).read_text()
    assert len([json.loads(line) for line in kept.splitlines()]) == 4
    assert away.main() == 0  # nothing is flown twice, and the numbers stay
    assert re.search(r" (\d+) fights; \1 were flown before", capsys.readouterr().out)
    assert away.kept_of(path).read_text() == kept
