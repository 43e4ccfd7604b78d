"""Tournaments between teams: a team is one entrant, and meets teams of the same sizes alone."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from saved_runs import TOY, write_run

from dronecombat_jax.config.fields import Config
from dronecombat_jax.errors import UserError
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.policies.file import save_policy
from dronecombat_jax.runs.evaluation import load_run
from dronecombat_jax.runs.export import policy_of_run
from dronecombat_jax.tournaments.entrants import read_field
from dronecombat_jax.tournaments.flights import load_flights
from dronecombat_jax.tournaments.result_file import load_result
from dronecombat_jax.types import Cause, Policy, TeamPolicy


def of(defenders: int, attackers: int) -> Config:
    game = replace(TOY.game, defenders=defenders, attackers=attackers)
    return replace(TOY, game=game)


@pytest.mark.long
def test_two_runs_of_two_against_one_and_scripted_teams(place: SimpleNamespace, tmp_path: Path):
    first, second = (
        write_run(tmp_path / name, of(2, 1), chunks=1, seed=seed)
        for seed, name in enumerate(("first", "second"))
    )
    assert place.fly(first, second, "scripted:all", flights=3) == 0
    result = load_result(place.folder)
    assert result.played.all() and result.played.shape == (2 + 5, 2 + 3)
    assert len(np.unique(result.cause)) >= 2 and np.all(result.cause != Cause.NONE)
    assert [(row.run, row.chunk, row.fights) for row in load_flights(place.folder)] == [
        ("first#4", 1, 3),
        ("second#4", 1, 3),
    ]


@pytest.mark.long
def test_a_team_with_a_policy_each_is_one_entrant_and_flown_mate_by_mate(
    place: SimpleNamespace, tmp_path: Path
):
    """Two that dive have crashed; if the second hovers, the fight goes on to its end. A file of the
    whole team is the same player.
    """
    config = of(2, 1)
    config = replace(config, game=replace(config.game, crash_rule="ends"))
    config = replace(config, learn=replace(config.learn, mates="own"))
    run = write_run(tmp_path / "own", config, chunks=1)
    team, info = policy_of_run(load_run(run), RunDirectory(run), "defender", None)
    assert isinstance(team, TeamPolicy)
    dives, hovers = (always(team.mates[0], thrust) for thrust in (-1.0, 0.5))
    teams = {"same": team, "divers": TeamPolicy((dives, dives)), "one": TeamPolicy((dives, hovers))}
    for name, policy in teams.items():
        save_policy(tmp_path / f"{name}.safetensors", policy, info)
    assert place.fly(run, *(tmp_path / f"{name}.safetensors" for name in teams)) == 0
    result = load_result(place.folder)
    assert [entrant.label for entrant in result.defenders] == ["own 1", "divers", "one"]
    assert result.played.all() and result.cause.shape == (3, 1, 3)
    assert np.all(result.cause[1] == Cause.DEFENDER_CRASH) and np.all(result.steps[1] < 30)
    assert np.all(result.cause[2] == Cause.TIMEOUT) and np.all(result.steps[2] == 30)


def always(policy: Policy, thrust: float) -> Policy:
    """A policy of the same shape whose action is `thrust` and no moment, whatever it sees."""
    *weights, last = policy.network.weights
    bias = np.array([thrust, 0.0, 0.0, 0.0], np.float32)
    network = policy.network.replace(
        weights=(*weights, np.zeros_like(last)), biases=(*policy.network.biases[:-1], bias)
    )
    return policy.replace(network=network)


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
