"""Tournaments between teams: a team is one entrant, and meets teams of the same sizes alone."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from saved_runs import TOY, write_run

from dronecombat_jax.config.fields import Config
from dronecombat_jax.errors import UserError
from dronecombat_jax.tournaments.entrants import read_field
from dronecombat_jax.tournaments.result_file import load_result
from dronecombat_jax.types import Cause


def of(defenders: int, attackers: int) -> Config:
    game = replace(TOY.game, defenders=defenders, attackers=attackers)
    return replace(TOY, game=game)


def test_two_runs_of_two_against_one_and_scripted_teams(
    place: SimpleNamespace, tmp_path: Path, capsys
):
    first, second = (
        write_run(tmp_path / name, of(2, 1), chunks=1, seed=seed)
        for seed, name in enumerate(("first", "second"))
    )
    assert place.fly(first, second, "scripted:all", flights=1) == 0
    result = load_result(place.folder)
    assert result.played.all() and result.played.shape == (2 + 4, 2 + 3)
    assert len(np.unique(result.cause)) >= 2 and np.all(result.cause != Cause.NONE)
    assert "no fight is recorded: 2 against 1 fly" in capsys.readouterr().out


@pytest.mark.parametrize(("defenders", "attackers"), [(1, 1), (2, 2), (3, 1)])
def test_other_sizes_are_refused_with_the_reason(defenders: int, attackers: int, tmp_path: Path):
    two = write_run(tmp_path / "two", of(2, 1), chunks=1)
    other = write_run(tmp_path / "other", of(defenders, attackers), chunks=1)
    with pytest.raises(UserError) as refused:
        read_field([str(two), str(other)])
    line = next(line for line in refused.value.message.splitlines() if "there, " in line)
    if defenders != 2:
        assert f"game.defenders is {defenders} there, 2 here" in line
    if attackers != 1:
        assert f"game.attackers is {attackers} there, 1 here" in line
