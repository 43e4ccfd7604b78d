"""Counting fights: intervals against known values, shares, and the command on a run that was just
begun.
"""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from dronecombat_jax.cli import commands as cli
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import (
    Config,
    GameConfig,
    LearnConfig,
    RandomiseConfig,
    RunConfig,
    SimConfig,
    TrainConfig,
)
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.files import checkpoint
from dronecombat_jax.runs import evaluation
from dronecombat_jax.runs.evaluation import (
    Match,
    drawn_numbers,
    file_name,
    game_flown,
    load_run,
    play,
    summary,
    with_interval,
)
from dronecombat_jax.selfplay.chunk import init_state
from dronecombat_jax.types import SIDES, Cause, FightResult

CONFIG = Config(
    sim=SimConfig(substeps=1),
    game=GameConfig(episode_steps=25),
    learn=LearnConfig(hidden_sizes=(8, 8), rollout_steps=6, minibatches=2),
    train=TrainConfig(num_envs=8, chunk_iterations=2, seed=5, total_steps=96),
    run=RunConfig(evaluation_fights=6),
)


# 0 of 10 and 10 of 10: z^2 / (n + z^2) = 0.2775; 1 of 10 and 50 of 100: Agresti and Coull's tables
@pytest.mark.parametrize(
    ("hits", "total", "low", "high"),
    [
        (0, 10, 0.0, 0.27753),
        (10, 10, 0.72247, 1.0),
        (1, 10, 0.01788, 0.40415),
        (50, 100, 0.40383, 0.59617),
        (0, 1, 0.0, 0.79345),
    ],
)
def test_share_intervals(hits, total, low, high):
    assert with_interval(hits, total) == pytest.approx((hits / total, low, high), abs=1e-5)


def test_summary_of_counted_fights():
    cause = np.array([1] * 3 + [2] * 2 + [3] + [4] + [5] + [6] + [7])
    down = np.zeros((10, 2), bool)
    down[[5, 7], 0], down[[6, 7], 1] = True, True
    result = summary(CONFIG, FightResult(cause, np.arange(1, 11) * 10, down))  # pyright: ignore[reportArgumentType]
    assert {name: share for name, (share, _, _) in result["win"].items()} == {
        "defender": 0.4,
        "draw": 0.3,
        "attacker": 0.3,
    }
    assert result["cause"]["intercept"][0] == 0.3
    assert sum(share for share, _, _ in result["cause"].values()) == pytest.approx(1.0)
    assert {role: share for role, (share, _, _) in result["crash"].items()} == {
        "defender": 0.2,
        "attacker": 0.2,
    }
    assert result["seconds"]["mean"] == pytest.approx(0.55) and result["seconds"][
        "p50"
    ] == pytest.approx(0.55)
    assert all(
        low <= share <= high
        for group in ("win", "cause", "crash")
        for share, low, high in result[group].values()
    )
    json.dumps(result, allow_nan=False)


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> SimpleNamespace:
    """A run that has not learnt yet: its configuration and checkpoint 0."""
    return begun(tmp_path_factory.mktemp("runs") / "begun", CONFIG)


def begun(path: Path, config: Config) -> SimpleNamespace:
    """A run of these settings, its numbers drawn."""
    (path / "checkpoints").mkdir(parents=True)
    (path / "config.toml").write_text(settings.to_toml(config))
    rng = np.random.default_rng(0)
    shapes = jax.eval_shape(lambda: init_state(Combat(config)))
    state = jax.tree.map(lambda leaf: (rng.random(leaf.shape) / 2).astype(leaf.dtype), shapes)
    checkpoint.save(path / "checkpoints", 0, state, {})
    return SimpleNamespace(path=path, state=state)


@pytest.mark.long
def test_the_command_writes_what_it_counted(run, capsys):
    assert cli.main(["evaluate", str(run.path), "--fights", "12", "--seed", "3"]) == 0
    printed = capsys.readouterr().out
    (row,) = json.loads((run.path / "evaluation-fights12-seed3.json").read_bytes())
    assert (row["seed"], row["steps"], row["fights"], row["stochastic"]) == (5, 0, 12, False)
    assert row["start_seed"] == 3
    for group in ("win", "cause"):
        assert sum(share for share, _, _ in row[group].values()) == pytest.approx(1.0)
    assert 0.01 <= row["seconds"]["p5"] <= row["seconds"]["p95"] <= 25 * 0.01 + 1e-9
    assert "seed 5 after 0 steps: 12 fights, mean actions" in printed

    saved = load_run(run.path, chunk=0)
    assert saved.iteration == 0 and all(
        np.array_equal(a, b)
        for a, b in zip(jax.tree.leaves(saved.state), jax.tree.leaves(run.state), strict=True)
    )
    again = play(saved, 0, Match(fights=12, seed=3))
    assert json.loads(json.dumps(summary(CONFIG, again))).items() <= row.items()  # the same fights
    assert (
        again.cause.shape == (12,)
        and np.all(again.cause != Cause.NONE)
        and np.all(again.steps <= 25)
    )
    assert np.all(again.steps[again.cause == Cause.TIMEOUT] == 25)


@pytest.mark.long
def test_what_was_drawn_for_each_fight_and_side_is_written_down(run):
    saved = load_run(run.path)
    assert drawn_numbers(saved, Match()) == {}
    wide = replace(saved.config, randomise=RandomiseConfig(mass=0.2, thrust=0.1))
    drawn = drawn_numbers(saved._replace(config=wide), Match(fights=50, seed=3))["drawn"]
    assert drawn.keys() == {"mass", "thrust"} and drawn["mass"].keys() == set(SIDES)
    for name, share in (("mass", 0.2), ("thrust", 0.1)):
        both = np.array([drawn[name][role] for role in SIDES])
        assert both.shape == (2, 50) and np.abs(both - 1).max() <= share + 1e-4
        assert both.std(axis=1).min() > 0.4 * share and np.abs(both[0] - both[1]).max() > share / 2


def test_a_checkpoint_that_is_not_there(run, tmp_path, capsys):
    with pytest.raises(UserError) as error:
        load_run(run.path, chunk=4)
    assert error.value.exit_code == EXIT_DATA and "no checkpoint 8" in error.value.message
    empty = tmp_path / "empty"
    empty.mkdir()
    (empty / "config.toml").write_text(settings.to_toml(CONFIG))
    assert cli.main(["evaluate", str(empty)]) == EXIT_DATA
    assert "no checkpoint" in capsys.readouterr().err


@pytest.mark.long
def test_a_scripted_pilot_takes_one_place(run, capsys):
    flags = ["--fights", "8", "--attacker", "dash", "--spawn", "uniform"]
    assert cli.main(["evaluate", str(run.path), *flags]) == 0
    assert (
        "8 fights, mean actions, attacker is the scripted dash, uniform starts"
        in capsys.readouterr().out
    )
    assert not (run.path / "evaluation.json").exists()  # that file tells of the run's own two
    beside = run.path / "evaluation-fights8-attacker_dash-spawn_uniform.json"
    (row,) = json.loads(beside.read_bytes())
    assert (row["attacker"], row["spawn"], row["fights"]) == ("dash", "uniform", 8)


OTHERS = {  # flags: the file that they are written to
    "--chunk 0": "evaluation-chunk0.json",
    "--stochastic": "evaluation-stochastic.json",
    "--fights 10": "evaluation-fights10.json",
    "--seed 1": "evaluation-seed1.json",
    "--spawn uniform": "evaluation-spawn_uniform.json",
    "--defender hover": "evaluation-defender_hover.json",
    "--attacker dash": "evaluation-attacker_dash.json",
    "--stochastic --chunk 0": "evaluation-chunk0-stochastic.json",
}


@pytest.mark.long
def test_only_the_runs_own_evaluation_has_its_name(run, monkeypatch, capsys):
    """Other options are written beside it and never over it."""
    fly = lambda saved, index, match: FightResult(
        np.full(match.fights, Cause.TIMEOUT),
        np.full(match.fights, 25),
        np.zeros((match.fights, 2), bool),
    )
    monkeypatch.setattr(evaluation, "play", fly)
    own = run.path / "evaluation.json"
    assert cli.main(["evaluate", str(run.path)]) == 0
    before = own.read_bytes()
    assert json.loads(before)[0]["fights"] == 6  # run.evaluation_fights
    for flags, name in OTHERS.items():
        (run.path / name).unlink(missing_ok=True)
        assert cli.main(["evaluate", str(run.path), *flags.split()]) == 0
        assert f"written to {run.path / name}" in capsys.readouterr().out
        assert (run.path / name).is_file() and own.read_bytes() == before
    assert cli.main(["evaluate", str(run.path), "--fights", "6"]) == 0
    assert own.read_bytes() == before and not (run.path / "evaluation-fights6.json").exists()
    own.unlink()


def test_a_name_tells_all_that_is_not_the_runs_own():
    everything = Match(10, 7, True, "hover_guard", "high_dive", "fixed", 4, 2)
    told = (
        "chunk3-stochastic-fights10-seed7-defender_hover_guard-attacker_high_dive-spawn_fixed-"
        "defenders4-attackers2"
    )
    assert file_name(everything, 3, 256) == f"evaluation-{told}.json"
    assert file_name(Match(10), None, 10) == "evaluation.json"


@pytest.mark.long
def test_teams_of_another_size_fly_where_the_observation_lets_them(tmp_path, capsys):
    """Two nearest defenders fly in fights of three against two, and alone as in a run of the duel."""
    sizes = {"defenders": 2, "attackers": 1}
    game = GameConfig(episode_steps=25, observation="nearest", **sizes)
    saved = begun(tmp_path / "pair", replace(CONFIG, game=game))
    flags = ["--fights", "5", "--defenders", "3", "--attackers", "2"]
    assert cli.main(["evaluate", str(saved.path), *flags]) == 0
    assert "5 fights, mean actions, 3 defenders, 2 attackers" in capsys.readouterr().out
    (row,) = json.loads((saved.path / "evaluation-fights5-defenders3-attackers2.json").read_bytes())
    assert (row["defenders"], row["attackers"]) == (3, 2) and "defender3" in row["crash"]
    loaded = load_run(saved.path)
    fights = play(loaded, 0, Match(5, defenders=3, attackers=2))
    assert fights.down.shape == (5, 5)
    as_trained = play(loaded, 0, Match(5))
    for given, same in zip(play(loaded, 0, Match(5, defenders=2)), as_trained, strict=True):
        np.testing.assert_array_equal(given, same)


@pytest.mark.parametrize(
    ("game", "mates", "told"),
    [
        ({}, "shared", "see 35 numbers, in fights of 2 against 1 they would see 51: "),
        (
            {"observation": "nearest", "defenders": 3},
            "own",
            "with learn.mates = own each drone of 3",
        ),
        ({"observation": "nearest", "crash_rule": "grounded"}, "shared", "crash_rule = grounded"),
    ],
)
def test_teams_in_which_a_run_cannot_fly_are_refused(game, mates, told):
    config = replace(
        CONFIG, game=replace(CONFIG.game, **game), learn=replace(CONFIG.learn, mates=mates)
    )
    with pytest.raises(UserError, match=told):
        game_flown(config, Match(defenders=2))


@pytest.mark.parametrize(
    ("flags", "told"),
    [
        (
            ["--attacker", "dahs"],
            "dahs: no scripted pilot has this name (attackers: dash, weave, high_dive",
        ),
        (["--defender", "dash"], "dash: no scripted pilot has this name (defenders: hover"),
    ],
)
def test_a_scripted_pilot_that_is_not_there(run, flags, told, capsys):
    assert cli.main(["evaluate", str(run.path), *flags]) == 2
    assert capsys.readouterr().err.startswith(f"error: {told}")
