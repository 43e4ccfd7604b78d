"""Recorded fights of a tournament; drones coast instead of being stepped by MJX."""

from pathlib import Path

import numpy as np
import pytest
from flown import rows as rows_of
from saved_runs import write_run
from toy import Coasting

from dronecombat_jax.analysis.result import by_training
from dronecombat_jax.arena import round_robin as arena_tournament
from dronecombat_jax.arena.lanes import Layout
from dronecombat_jax.arena.rectangle import Rules
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.tournaments import tournament as tournaments
from dronecombat_jax.tournaments.flights import FLIGHTS_NAME, load_flights, save_flights
from dronecombat_jax.tournaments.result_file import load_result

FIGHTS = 6


@pytest.mark.long
def test_recorded_fights_are_those_of_the_grid(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr(tournaments, "Combat", Coasting)
    monkeypatch.setattr(
        arena_tournament, "CPU_LAYOUT", Layout(lanes=32, block=8, blocks=8, steps=5)
    )
    write_run(tmp_path / "one", chunks=2)
    write_run(tmp_path / "two", chunks=range(1, 2), seed=0)  # as the first chunk of `one`
    words = [str(tmp_path / "one"), str(tmp_path / "two"), "scripted:dash"]
    root = str(tmp_path / "tournaments")
    assert (
        tournaments.tournament(words, Rules(FIGHTS, seed=3), root=root, name="it", flights=FIGHTS)
        == 0
    )
    result, flown = (
        load_result(tmp_path / "tournaments/it"),
        load_flights(tmp_path / "tournaments/it"),
    )
    assert [(one.run, one.chunk, one.fights) for one in flown] == [
        ("one#4", 1, 6),
        ("one#4", 2, 6),
        ("two#4", 1, 6),
    ]
    assert flown[2][3:] == flown[0][3:]  # the same policies
    sides = by_training(result.defenders)["one#4"], by_training(result.attackers)["one#4"]
    for one, (row, _), (column, _) in zip(flown, *sides, strict=False):
        # The grid's program flew the same starts.
        assert one.time == pytest.approx(result.steps[row, column].mean() * result.control_dt)
        assert 0.0 < one.control_effort[0] <= 4.0 and one.lowest[1] <= one.altitude[1]


def test_what_was_not_measured_is_null_and_damage_is_one_line(tmp_path: Path):
    assert load_flights(tmp_path) == ()
    save_flights(tmp_path, ())
    assert load_flights(tmp_path) == ()
    for text in ("{", "[1]", '[{"run": "x"}]', "null", "\x00"):
        (tmp_path / FLIGHTS_NAME).write_text(text)
        with pytest.raises(UserError, match="damaged") as caught:
            load_flights(tmp_path)
        assert caught.value.exit_code == EXIT_DATA and "\n" not in caught.value.message


def test_numbers_survive_the_file(
    tmp_path: Path,
):
    rows = rows_of(2)
    rows[0] = rows[0]._replace(approach_angle=float("nan"))
    save_flights(tmp_path, rows)
    read = load_flights(tmp_path)
    assert read[1] == rows[1] and np.isnan(read[0].approach_angle)
