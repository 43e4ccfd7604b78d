"""Studies: what a study file says, which trainings follow from it, and the table they end in."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import measured
import pytest
import variants
from kept import Kept

from dronecombat_jax.config import settings

ROOT = Path(__file__).resolve().parents[2]
STUDY = """
preset = "smoke"
steps = 9_000
seeds = [3, 4]
[variants.plain]
about = "as it is"
[variants.other]
preset = "duel"
seeds = [5]
"game.swept_events" = false
"learn.hidden_sizes" = [8, 16]
"selfplay.opponents" = "attacker=past 0.3"
"""


def record(steps: int, intercept=0.5, reached=0.4, down=0.1, episodes=100) -> dict:
    return {
        "steps": steps, "episodes": episodes, "outcome/intercept": intercept,
        "outcome/reached": reached, "outcome/timeout": 1.0 - intercept - reached,
        "crash/defender": down, "crash/attacker": 0.0,
    }  # fmt: skip


def test_a_study_and_its_commands(tmp_path):
    (tmp_path / "mine.toml").write_text(STUDY)
    study = variants.read_study(tmp_path / "mine.toml")
    plain, other = study.variants
    assert (study.name, plain.about, plain.seeds, plain.steps) == ("mine", "as it is", (3, 4), 9000)
    assert (other.preset, other.seeds) == ("duel", (5,))
    words = variants.command(other, 5, tmp_path)
    assert words[words.index("--name") + 1] == "other-5"
    assert words[-5:] == [
        "--game.no-swept-events",
        *("--learn.hidden-sizes", "8", "16"),
        "--selfplay.opponents=attacker=past 0.3",
    ]


def test_a_variant_on_another(tmp_path):
    (tmp_path / "mine.toml").write_text(
        STUDY
        + """
[variants.third]
on = "other"
steps = 70
"game.swept_events" = true
"""
    )
    *_, other, third = variants.read_study(tmp_path / "mine.toml").variants
    assert (third.about, third.preset, third.seeds, third.steps) == ("", "duel", (5,), 70)
    assert third.settings == {**other.settings, "game.swept_events": True}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('presets = "duel"', "mine.toml: presets: no key of a study"),
        ('preset = "duel"\nsteps = 9\n[variants.a]', "mine.toml: seeds is missing, for variant a"),
        (
            'preset = "duel"\nsteps = 9\nseeds = [1]\n[variants.a]\non = "b"\n[variants.b]',
            "mine.toml: variants.a.on = 'b': no variant above it",
        ),
    ],
)
def test_mistakes(tmp_path, text, message):
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(SystemExit, match=message):
        variants.read_study(tmp_path / "mine.toml")


def test_a_file_that_cannot_be_read_is_one_line(tmp_path):
    (tmp_path / "mine.toml").write_text("preset = ")
    for name in ("mine.toml", "none.toml"):
        with pytest.raises(SystemExit, match=f"{name}: .*(Invalid value|No such file)"):
            variants.read_study(tmp_path / name)


def test_no_lanes_are_refused(monkeypatch, capsys):
    study = str(ROOT / "experiments" / "studies" / "readings.toml")
    monkeypatch.setattr(sys, "argv", ["variants.py", study, "--lanes", "0"])
    with pytest.raises(SystemExit):
        variants.read_flags()
    assert "--lanes 0: at least 1" in capsys.readouterr().err


def test_a_run_that_went_on_is_measured_again(tmp_path, monkeypatch):
    monkeypatch.setattr(measured, "against", lambda run: {"dash": 0.5})
    for steps in (measured.WINDOW, 2 * measured.WINDOW):
        lines = [
            json.dumps(record(step)) for step in range(measured.WINDOW, steps + 1, measured.WINDOW)
        ]
        (tmp_path / "metrics.jsonl").write_text("\n".join(lines) + "\n")
        for _ in range(2):  # then as it was written
            found = measured.of(tmp_path, steps)
            assert found is not None and found["steps"] == steps


@pytest.mark.parametrize(
    "path", sorted((ROOT / "experiments" / "studies").glob("*.toml")), ids=lambda path: path.stem
)
def test_studies_of_the_project_name_settings_that_exist(path):
    study = variants.read_study(path)
    assert study.variants
    for variant in study.variants:
        settings.load(variant.preset, {**variant.settings, "train.total_steps": variant.steps})


def test_a_fight_begins_with_the_first_window_in_which_all_bars_hold():
    million = measured.WINDOW
    records = [record(million // 2, down=0.5), record(million), record(2 * million, reached=0.0)]
    assert measured.fights_from(records) is None  # the first window: down in 0.3
    assert measured.fights_from([*records, record(5 * million // 2), record(3 * million)]) == 3e6


def test_the_curve_has_every_window_and_none_where_no_fight_ended():
    million = measured.WINDOW
    curve = measured.curve(
        [record(million // 2, down=0.2), record(million, down=0.4), record(3 * million)]
    )
    assert [window["defender down"] for window in curve] == [pytest.approx(0.3), None, 0.1]
    assert measured.curve([]) == []


def test_what_runs_came_to_is_kept_beside_the_study_for_the_same_settings(tmp_path):
    study = tmp_path / "mine.toml"
    study.write_text(STUDY)
    plain, other = variants.read_study(study).variants
    kept = Kept(study)
    kept.keep("plain", 4, plain.changed, {"fights": True})
    kept.keep("other", 5, other.changed, {"fights": False})
    kept.keep("plain", 4, plain.changed, {"fights": False})  # measured again
    assert len((tmp_path / "mine.jsonl").read_text().splitlines()) == 2
    again = Kept(study)
    assert again.find("plain", 4, plain.changed) == {"fights": False}
    assert again.find("plain", 3, plain.changed) is None
    assert again.find("other", 5, other.changed) == {"fights": False}
    longer = other._replace(steps=18_000)
    assert again.find("other", 5, longer.changed) is None
    (tmp_path / "mine.jsonl").write_text("{half a line")
    with pytest.raises(SystemExit, match=r"mine\.jsonl: "):
        Kept(study)
    assert other.changed["learn.hidden_sizes"] == [8, 16] and "train.seed" not in other.changed


def test_two_writers_of_one_study_keep_each_others_runs(tmp_path):
    study = tmp_path / "mine.toml"
    one, other = Kept(study), Kept(study)
    one.keep("plain", 3, {}, {"steps": 1})
    other.keep("plain", 4, {}, {"steps": 2})
    assert Kept(study).find("plain", 3, {}) == {"steps": 1}
    assert Kept(study).find("plain", 4, {}) == {"steps": 2}


def test_the_table_tells_worst_and_best_seed():
    def run(share: float, start: int | None) -> dict:
        return {
            "shares": dict.fromkeys(measured.NAMES, share), "fights": start is not None,
            "fights_from": start, "against": dict.fromkeys((*measured.DEFENDERS, *measured.ATTACKERS), share),
        }  # fmt: skip

    three = [run(0.2, 4_000_000), run(0.4, None), run(0.3, None)]
    text = measured.markdown([("a", "", three), ("b", "", []), ("c", "", three[:2])])
    lines = text.splitlines()
    assert "| 1 of 3 | never (never) | 0.30 ± 0.25 (0.20 to 0.40) |" in lines[2]
    assert "| `b` | not run |" in lines[3] and text.count("`b`") == 1
    assert "| 1 of 2 | never (never) | 0.20, 0.40 |" in lines[4]  # two seeds: their own numbers
    assert lines[6].startswith("| variant | stops dash |")
    assert lines[8] == "| `a` |" + " 0.30 ± 0.25 (0.20 to 0.40) |" * 7


def test_one_row_for_each_finished_run(tmp_path):
    run = tmp_path / "mine"
    run.mkdir()
    with pytest.raises(SystemExit, match="mine: no finished run"):
        measured.row(run)
    (run / "metrics.jsonl").write_text(json.dumps(record(2_000_000) | {"seed": 0}) + "\n")
    against = dict.fromkeys((*measured.DEFENDERS, *measured.ATTACKERS), 0.25)
    shares = dict.fromkeys(measured.NAMES, 0.5)
    numbers = {"steps": 2_000_000, "shares": shares, "fights_from": None, "against": against}
    (run / "measured.json").write_text(json.dumps(numbers))
    cause = {"intercept": [0.75, 0.7, 0.8], "reached": [0.125, 0.1, 0.2]}
    (run / "evaluation.json").write_text(json.dumps([{"cause": cause}]))
    assert measured.row(run).startswith("| mine | never | 0.50 | 0.50 |")
    assert measured.row(run).endswith("| 0.25, 0.25 | 0.75, 0.12 |")
    (run / "evaluation.json").write_text(json.dumps([{"cause": cause}] * 2))
    with pytest.raises(SystemExit, match="2 seeds: only runs of one seed"):
        measured.row(run)


@pytest.mark.slow
def test_a_whole_study_goes_on_where_it_stopped(tmp_path):
    study = STUDY.replace('preset = "duel"', "").replace("seeds = [5]", "")
    (tmp_path / "mine.toml").write_text(study.replace("[3, 4]", "[3]"))
    words = [sys.executable, str(ROOT / "experiments" / "variants.py"), str(tmp_path / "mine.toml")]
    run = lambda *flags: subprocess.run(
        [*words, "--runs", str(tmp_path / "runs"), *flags], capture_output=True, text=True
    )
    assert "not run" in run("--table").stdout
    done = run("--lanes", "1")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("trained") == 2 and "not run" not in done.stdout
    found = json.loads((tmp_path / "runs" / "mine" / "plain-3" / "measured.json").read_text())
    assert found["steps"] >= 9000 and 0.0 <= found["against"]["dash"] <= 1.0
    again = run()
    assert "trained" not in again.stdout and again.stdout.strip().startswith("| variant")
    shutil.rmtree(tmp_path / "runs")  # as on another machine
    elsewhere = run()
    assert elsewhere.stdout == again.stdout and not list((tmp_path / "runs").glob("*/*/"))
