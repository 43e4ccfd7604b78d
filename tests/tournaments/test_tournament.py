"""The tournament's folder: resumed, extended, repeated, damaged; drones coast instead of being
stepped by MJX.
"""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from saved_runs import write_run
from small_tournament import CHUNKS, RULES
from tournaments import assert_same, from_letters, words

from dronecombat_jax.analysis.panel import cells_needed
from dronecombat_jax.analysis.result import by_training
from dronecombat_jax.config.starts import EVEN_SETBACK
from dronecombat_jax.errors import (
    EXIT_CANNOT_WRITE,
    UserError,
)
from dronecombat_jax.files.lock import exclusive_lock
from dronecombat_jax.tournaments.result_file import ABOUT_NAME, load_about, load_result
from dronecombat_jax.tournaments.standings import standings_text
from dronecombat_jax.tournaments.tournament import default_name
from dronecombat_jax.types import Cause


def test_the_result_is_whole(alone: SimpleNamespace):
    result, about = alone.result, load_about(alone.folder)
    assert result.counts.shape == (CHUNKS + 1, CHUNKS + 1, len(Cause)) and np.all(
        result.counts.sum(axis=2) == 3
    )
    assert result.played.all() and [one.label for one in result.attackers][-2:] == [
        "five 5",
        "dash",
    ]
    assert (
        len(np.unique(result.cause)) >= 3 and result.steps.max() == 30 and result.control_dt == 0.02
    )
    assert about == json.loads((alone.folder / ABOUT_NAME).read_text())
    assert (about["episodes"], about["seed"], about["stochastic"], about["fights"]) == (
        3,
        5,
        False,
        108,
    )


@pytest.mark.long
def test_from_other_starts_it_is_another_tournament(
    runs: Path, alone: SimpleNamespace, place: SimpleNamespace
):
    assert place.fly(*words(runs), spawn="even") == 0
    result, about = load_result(place.folder), load_about(place.folder)
    assert about["environment_digest"] != load_about(alone.folder)["environment_digest"]
    assert about["environment"]["game.defender_setback"] == EVEN_SETBACK
    assert about["spawn"] == "even" and any("even" in line for line in about["notices"])
    assert np.any(result.steps != alone.result.steps)
    assert default_name(["a", "b"], "even") == "a-b-even"


@pytest.mark.long
def test_some_cells_alone_and_then_the_rest(
    runs: Path, alone: SimpleNamespace, place: SimpleNamespace, capsys
):
    needed = cells_needed(alone.result.defenders, alone.result.attackers)
    assert place.fly(*words(runs), cells=cells_needed) == 0
    part = load_result(place.folder)
    assert (
        len(place.cells) == needed.sum() < 36
        and f"{needed.sum()} of these pairs x 3" in capsys.readouterr().out
    )
    np.testing.assert_array_equal(part.played, needed)
    np.testing.assert_array_equal(part.cause[needed], alone.result.cause[needed])
    assert any("left out on purpose" in line for line in load_about(place.folder)["notices"])
    assert place.fly(*words(runs)) == 0 and len(place.cells) == 36 - needed.sum()
    assert_same(load_result(place.folder), alone.result)


@pytest.mark.long
def test_a_policy_that_was_saved_twice_is_in_the_result_at_both_times(
    runs: Path, place: SimpleNamespace, tmp_path: Path
):
    run = tmp_path / "five"
    shutil.copytree(runs / "five", run)
    copied = write_run(tmp_path / "again", chunks=range(1, 3), seed=0)
    names = [str(run), str(copied), "scripted:hover", "scripted:dash"]
    assert place.fly(*names) == 0 and len(place.cells) == 36
    result = load_result(place.folder)
    also = [[name.label for name in one.also] for one in result.defenders]
    assert also == [["again 1"], ["again 2"], [], [], [], []]
    assert list(by_training(result.attackers)) == ["five#4", "again#4"]


def test_the_same_again_flies_nothing_and_changes_no_byte(
    runs: Path, alone: SimpleNamespace, place: SimpleNamespace
):
    shutil.copytree(alone.folder, place.folder)
    before = {path.name: path.read_bytes() for path in place.folder.rglob("*.[nj]*")}
    assert place.fly(*words(runs)) == 0 and place.cells == []
    assert {path.name: path.read_bytes() for path in place.folder.rglob("*.[nj]*")} == before


@pytest.mark.long
def test_appended_checkpoints_fly_the_new_cells_alone(
    runs: Path, place: SimpleNamespace, tmp_path: Path, alone
):
    shorter = tmp_path / "five"
    shutil.copytree(runs / "five", shorter)
    for iteration in (8, 10):
        shutil.rmtree(shorter / "checkpoints" / str(iteration))
    assert place.fly(shorter, "scripted:hover", "scripted:dash") == 0
    assert len(place.cells) == 16
    assert place.fly(*words(runs)) == 0
    assert len(place.cells) == 36 - 16
    assert_same(load_result(place.folder), alone.result)


@pytest.mark.long
def test_other_rules_are_other_fights_beside_the_old_ones(
    runs: Path, alone: SimpleNamespace, place: SimpleNamespace
):
    shutil.copytree(alone.folder, place.folder)
    assert place.fly(*words(runs), rules=RULES._replace(seed=6)) == 0 and len(place.cells) == 36
    assert np.any(load_result(place.folder).steps != alone.result.steps)
    assert place.fly(*words(runs)) == 0 and place.cells == []
    assert_same(load_result(place.folder), alone.result)


def test_one_process_alone_may_fly_it(runs: Path, place: SimpleNamespace):
    place.folder.mkdir(parents=True)
    with exclusive_lock(place.folder), pytest.raises(UserError) as caught:
        place.fly(*words(runs))
    assert caught.value.exit_code == EXIT_CANNOT_WRITE and "in use by" in caught.value.message


def test_the_table_states_its_gauge(alone: SimpleNamespace):
    text = standings_text(alone.result, top=3)
    assert "the mean over all players of both sides is 1500" in text and "only differences" in text
    rows = [line for line in text.splitlines() if line.startswith(("  five", "  hover", "  dash"))]
    assert len(rows) == 6 and text.count("... and 3 more") == 2


def test_the_table_calls_only_those_unbeaten_who_are():
    """Two groups: the first pair beats the second, and each beats the other at times."""
    result = from_letters([["wl", "ww"], ["ll", "wl"]])
    told = [line for line in standings_text(result).splitlines() if line.startswith("  ippo")]
    assert [line.rpartition("  ")[2] for line in told] == [
        "open above",
        "open below",
        "open above",
        "open below",
    ]
    unbeaten = standings_text(from_letters([["ww", "ww"], ["wl", "wl"]]))
    assert unbeaten.count("never beaten") == 1 and unbeaten.count("open above") == 0


@pytest.mark.parametrize(
    ("named", "expected"),
    [
        (["runs/ippo", "sippo", "scripted:all"], "ippo-sippo"),
        (["scripted:all"], "all"),
        (["x/my best.safetensors", "runs/v1.2"], "my-best-v1.2"),
        (["x" * 300], "x" * 100),
    ],
)
def test_names_of_folders(named: list[str], expected: str):
    assert default_name(named) == expected
