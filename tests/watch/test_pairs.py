"""A click on a tournament's win-rate map: the page of fights, and what the report says of it."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from saved_runs import TOY, write_run
from small_tournament import LAYOUT, RULES
from toy import Coasting

from dronecombat_jax.arena import round_robin
from dronecombat_jax.arena.rectangle import Rules
from dronecombat_jax.config.fields import Config
from dronecombat_jax.report import tournament_report
from dronecombat_jax.tournaments import tournament as tournaments
from dronecombat_jax.tournaments.result_file import load_about, load_result
from dronecombat_jax.types import Cause
from dronecombat_jax.watch import pairs

CHUNKS = 4


@pytest.fixture(autouse=True)
def toy(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (tournaments, pairs):
        monkeypatch.setattr(module, "Combat", Coasting)
    monkeypatch.setattr(round_robin, "CPU_LAYOUT", LAYOUT)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """A run of four chunks, its tournament, its report and the data of its page of fights."""
    return whole(tmp_path_factory.mktemp("flown"), TOY, RULES)


def whole(root: Path, config: Config, rules: Rules) -> SimpleNamespace:
    """The same of a run with these settings."""
    write_run(root / "four", config, chunks=CHUNKS)
    with pytest.MonkeyPatch.context() as patch:
        for module in (tournaments, pairs):
            patch.setattr(module, "Combat", Coasting)
        patch.setattr(round_robin, "CPU_LAYOUT", LAYOUT)
        words = [str(root / "four"), "scripted:all"]
        assert tournaments.tournament(words, rules, root=str(root / "tournaments")) == 0
        folder = root / "tournaments" / "four"
        assert tournament_report.report(str(folder), None, pairs.fights_page) == 0
    return SimpleNamespace(run=root / "four", folder=folder, data=read(folder / "report"))


def read(report: Path) -> dict:
    """What the page's script is given."""
    html = (report / "fights.html").read_text()
    (text,) = re.findall(r'dronecombatPairs\("replay", (\{.*\})\);</script>', html)
    return json.loads(text)


@pytest.mark.long
def test_every_cell_has_the_fight_that_was_counted(flown: SimpleNamespace):
    assert_counted(flown)


@pytest.mark.long
def test_every_cell_of_teams_has_the_fight_that_was_counted(tmp_path: Path):
    """Two against one, and each drone draws its own actions."""
    game = replace(TOY.game, defenders=2, attackers=1)
    teams = whole(tmp_path, replace(TOY, game=game), RULES._replace(stochastic=True))
    assert_counted(teams)
    assert teams.data["fights"][0]["names"] == ["defender 1", "defender 2", "attacker"]


def assert_counted(flown: SimpleNamespace) -> None:
    """Every cell's fight has the outcome and the time of the first one that the tournament counted."""
    result = load_result(flown.folder)
    (shown,) = flown.data["maps"]
    numbers = np.asarray(shown["fights"])
    assert numbers.shape == (CHUNKS, CHUNKS)
    assert (
        sorted(numbers.ravel()) == list(range(CHUNKS**2)) == list(range(len(flown.data["fights"])))
    )
    sides = ([one.label for one in side] for side in (result.defenders, result.attackers))
    defenders, attackers = sides
    for cell in np.ndindex(numbers.shape):
        fight = flown.data["fights"][numbers[cell]]
        pair = defenders.index(fight["defender"]), attackers.index(fight["attacker"])
        assert pair == (
            defenders.index(f"four {cell[0] + 1}"),
            attackers.index(f"four {cell[1] + 1}"),
        )
        steps = result.steps[*pair, 0]
        assert fight["result"]["time"] == pytest.approx(steps * result.control_dt)
        winner = result.winner[Cause(result.cause[*pair, 0])].name.lower()
        assert fight["result"]["winner"] == {"draw": "nobody"}.get(winner, winner)
        assert shown["rates"][cell[0]][cell[1]] == pytest.approx(
            np.mean([result.winner[cause].name == "DEFENDER" for cause in result.cause[pair]]),
            abs=1e-4,
        )


@pytest.mark.long
def test_the_report_links_to_every_cell(flown: SimpleNamespace):
    html = (flown.folder / "report" / "report.html").read_text()
    links = re.findall(
        r'<a href="fights.html#(\d+)-(\d+)-(\d+)" target="_blank"><rect x="([\d.]+)" y="([\d.]+)"',
        html,
    )
    assert [tuple(map(int, link[:3])) for link in links] == [
        (0, *cell) for cell in np.ndindex(CHUNKS, CHUNKS)
    ]
    places = {tuple(map(int, link[1:3])): (float(link[3]), float(link[4])) for link in links}
    assert places[0, 0][0] < places[0, 1][0] and places[0, 0][1] > places[1, 0][1]  # upwards
    assert "<script" not in html


@pytest.mark.long
def test_a_report_without_the_players_says_so(flown: SimpleNamespace, tmp_path: Path):
    folder = tmp_path / "four"
    shutil.copytree(flown.folder, folder, ignore=shutil.ignore_patterns("report"))
    hidden = flown.run.with_name("hidden")
    flown.run.rename(hidden)
    try:
        assert tournament_report.report(str(folder), None, pairs.fights_page) == 0
    finally:
        hidden.rename(flown.run)
    html = (folder / "report" / "report.html").read_text()
    assert "No cell of the win-rate map can be clicked" in html and "fights.html" not in html
    assert not (folder / "report" / "fights.html").exists()


@pytest.mark.long
def test_a_run_that_was_trained_anew_is_not_shown_in_place_of_the_old(
    flown: SimpleNamespace, tmp_path: Path
):
    folder = tmp_path / "four"
    shutil.copytree(flown.folder, folder, ignore=shutil.ignore_patterns("report"))
    hidden = flown.run.with_name("hidden")
    flown.run.rename(hidden)
    write_run(flown.run, chunks=CHUNKS, seed=1)
    try:
        assert tournament_report.report(str(folder), None, pairs.fights_page) == 0
    finally:
        shutil.rmtree(flown.run)
        hidden.rename(flown.run)
    html = (folder / "report" / "report.html").read_text()
    assert "no policy of the maps is at hand any more" in html


def test_words_are_found_from_any_folder(flown: SimpleNamespace):
    assert load_about(flown.folder)["words"] == [str(flown.run), "scripted:all"]
