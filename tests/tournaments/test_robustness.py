"""A matrix flown again under gaps: what is flown, kept, gone on with and written.

Drones coast here instead of being stepped by MJX; a drone with another thrust is pushed so.
"""

import json
from pathlib import Path
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from small_tournament import LAYOUT, RULES
from tournaments import words
from toy import Coasting

from dronecombat_jax.arena import round_robin as arena_tournament
from dronecombat_jax.cli import commands
from dronecombat_jax.config.fields import Config
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA, EXIT_STOPPED, UserError
from dronecombat_jax.report.robustness_figure import robustness_figure
from dronecombat_jax.tournaments import flying, reality, robustness
from dronecombat_jax.tournaments import tournament as tournaments
from dronecombat_jax.tournaments.result_file import load_result

GAPS = "other_starts,thrust_minus"


class Gliding(Coasting):
    def __init__(self, config: Config):
        super().__init__(config)
        self._fly_craft = self._glide

    def _glide(self, qpos, qvel, craft, clock, action: jax.Array):
        return *self._coast(qpos, qvel, craft.drawn.thrust[:, None] * action), craft


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> SimpleNamespace:
    """`fly(words, **how)` in tournaments/ of a folder of its own; `cells`: how many were flown."""
    counted = SimpleNamespace(cells=0, stop_after=10**9)
    real = arena_tournament.play

    def play(*args, **how):
        for harvest in real(*args, **how):
            counted.cells += len(harvest.cells)
            yield harvest
            if counted.cells >= counted.stop_after:
                return

    monkeypatch.setattr(flying, "play", play)
    monkeypatch.setattr(arena_tournament, "CPU_LAYOUT", LAYOUT)
    for module in (robustness, tournaments):
        monkeypatch.setattr(module, "Combat", Gliding)
    root = str(tmp_path / "tournaments")

    def fly(*named, gaps: str = GAPS, together: bool = False, **how):
        planned = robustness.plan([str(word) for word in named], root=root, **how)
        return robustness.robustness(planned, gaps=gaps, together=together)

    counted.fly, counted.root = fly, tmp_path / "tournaments"
    return counted


@pytest.mark.long
def test_a_tournament_is_flown_again_and_its_own_cells_are_not(
    runs: Path, flown: SimpleNamespace, capsys
):
    """36 cells of its own; then the control and one gap for each side, 3 x 36."""
    assert tournaments.tournament(words(runs), RULES, root=str(flown.root), name="it") == 0
    before, flown.cells = load_result(flown.root / "it"), 0
    code, report = flown.fly("it")
    assert code == 0 and flown.cells == 3 * 36
    rows = {(row["gap"], row["role"]): row for row in report["rows"]}
    assert len(rows) == 4 and rows["thrust_minus", "defender"]["drones"] == "defender"
    assert rows["thrust_minus", "attacker"]["settings"] == {"attacker.thrust": 0.8}
    score = np.asarray(before.winner)[before.cause]
    mean = np.mean(np.select([score == 0, score == 1], [1.0, 0.5], 0.0))
    assert all(rows[gap, "defender"]["nominal"] == pytest.approx(mean) for gap, _ in rows)
    control = [rows["other_starts", side]["loss"] for side in ("defender", "attacker")]
    assert control[0] == pytest.approx(-control[1])
    # these drones are pushed by their actions alone: 20 % less changes how fights end
    assert any(abs(rows["thrust_minus", side]["loss"]) > 0.01 for side in ("defender", "attacker"))
    folder = flown.root / "it" / robustness.FOLDER
    assert json.loads((folder / robustness.FILE).read_text()) == report
    table = (folder / "robustness.md").read_text()
    assert table in capsys.readouterr().out and table.count("\n| ") == 5
    assert "| thrust and moments - 20 % | attacker | attacker |" in table
    assert len(robustness_figure(report).axes) == 2
    flown.cells = 0
    assert flown.fly("it") == (0, report) and flown.cells == 0


@pytest.mark.long
def test_it_goes_on_where_it_was_stopped(runs: Path, flown: SimpleNamespace):
    flown.stop_after = 50
    code, report = flown.fly(*words(runs), episodes=2, name="stopped", gaps="thrust_minus")
    assert (code, report) == (EXIT_STOPPED, {}) and 50 <= flown.cells < 3 * 36
    done, flown.stop_after = flown.cells, 10**9
    code, report = flown.fly(*words(runs), episodes=2, name="stopped", gaps="thrust_minus")
    assert code == 0 and flown.cells == 3 * 36 and done < flown.cells
    assert len(report["rows"]) == 2 and report["rows"][0]["fights"] == 72


@pytest.mark.slow
def test_both_sides_together_are_one_matrix(flown: SimpleNamespace):
    """Scripted pilots alone, too; the second side's loss is the first one's gain."""
    named = ("scripted:hover", "scripted:hover_guard", "scripted:dash")
    code, report = flown.fly(*named, gaps="thrust_minus", together=True, episodes=2, name="pilots")
    assert code == 0
    defender, attacker = report["rows"]
    assert defender["loss"] == pytest.approx(-attacker["loss"])
    assert defender["kendall"] is None and attacker["players"] == 1
    assert len(robustness_figure(report).axes) == 2


@pytest.mark.long
def test_what_a_tournament_has_is_not_given_again(alone: SimpleNamespace):
    for flags in ({"seed": 3}, {"name": "mine"}, {"every": 2}, {"stochastic": True}):
        with pytest.raises(UserError) as raised:
            robustness.plan([str(alone.folder)], **flags)
        assert raised.value.exit_code == EXIT_CONFIG and "has its own" in raised.value.message
    planned = robustness.plan([str(alone.folder)], episodes=2)
    assert planned.rules == RULES._replace(episodes=2) and planned.path == alone.folder
    assert [Path(word).name for word in planned.words][:1] == ["five"]


def test_a_tournament_that_is_not_complete_is_one_line(tmp_path: Path):
    (tmp_path / "half" / "cells").mkdir(parents=True)
    with pytest.raises(UserError) as raised:
        robustness.plan(["half"], root=str(tmp_path))
    assert raised.value.exit_code == EXIT_DATA and "is not complete" in raised.value.message


def test_pairs_that_a_tournament_left_out_are_left_out(alone: SimpleNamespace):
    result = alone.result
    part = result._replace(played=result.played & (np.arange(6) != 2)[:, None])
    some = [
        result.defenders[1:4],
        (*result.attackers[:2], result.attackers[0]._replace(identity="new")),
    ]
    asked = robustness._flown_in(part, some)
    np.testing.assert_array_equal(asked, [[True, True, False], [False] * 3, [True, True, False]])


@pytest.mark.slow
def test_the_command_flies_real_gaps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    """In MJX: late sensors alone change nothing for scripted pilots; half the thrust does."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(arena_tournament, "CPU_LAYOUT", LAYOUT)
    monkeypatch.setitem(
        reality.GAPS, "weak", reality.Gap("weak", "weak", reality._factor("thrust", 0.5))
    )
    words = ["scripted:hover_guard", "scripted:pure_pursuit", "scripted:dash", "scripted:weave"]
    gaps = "weak,limits,drag,latency_80"
    assert (
        commands.main(["robustness", *words, "--gaps", gaps, "--episodes", "3", "--name", "s"]) == 0
    )
    folder = tmp_path / "tournaments" / "s" / robustness.FOLDER
    report = json.loads((folder / robustness.FILE).read_text())
    rows = {(row["gap"], row["drones"], row["role"]): row for row in report["rows"]}
    assert len(rows) == 2 + 2 + 2 + 2
    assert rows["latency_80", "defender", "defender"]["loss"] == 0.0  # they know the state itself
    assert rows["weak", "attacker", "attacker"]["loss"] > 0.3  # it cannot even hover
    assert (folder / "robustness.png").stat().st_size > 10_000
    assert "written to" in capsys.readouterr().out
