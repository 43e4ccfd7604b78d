"""Who takes part: what the words mean, each content once, bad checkpoints and other games refused
with all names.
"""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drones import write
from own_bodies import write_body
from policies import make_info, make_policy
from saved_runs import TOY, damage, write_run

from dronecombat_jax.analysis.result import SCRIPTED
from dronecombat_jax.combat.fingerprint import environment
from dronecombat_jax.config.fields import Config, SimConfig
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA, UserError
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.policies.file import save_policy
from dronecombat_jax.runs.evaluation import load_run
from dronecombat_jax.runs.export import policy_of_run
from dronecombat_jax.tournaments.contenders import EXPORTED, find
from dronecombat_jax.tournaments.entrants import read_field
from dronecombat_jax.types import ATTACKER, DEFENDER, Policy


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs `ten` of ten chunks and `two` of two chunks and two seeds, whose seed 4 is not that of
    `ten`.
    """
    root = tmp_path_factory.mktemp("runs")
    write_run(root / "ten", chunks=10)
    write_run(root / "two", replace(TOY, train=replace(TOY.train, num_seeds=2)), chunks=2, seed=1)
    return root


@pytest.fixture
def bad(home: Path, tmp_path: Path) -> Path:
    """`ten` with three bad checkpoints: two damaged, one gone."""
    run = tmp_path / "ten"
    shutil.copytree(home / "ten", run)
    damage(run, 3)
    damage(run, 10)
    shutil.rmtree(run / "checkpoints" / "14")
    return run


def labels(words, role: int, **how) -> list[str]:
    return [
        seat.entrant.label for seat in read_field([str(word) for word in words], **how).seats[role]
    ]


def refusal(words, **how) -> UserError:
    with pytest.raises(UserError) as caught:
        read_field([str(word) for word in words], **how)
    return caught.value


@pytest.mark.long
def test_a_run_stands_for_both_sides_after_every_chunk(home: Path):
    field = read_field([str(home / "ten")])
    for side in field.seats:
        assert [seat.entrant.label for seat in side] == [f"ten {chunk}" for chunk in range(1, 11)]
        one = side[2].entrant
        assert (one.method, one.run, one.seed, one.chunk) == ("ippo", "ten", 4, 3)
        assert one.steps == 3 * TOY.steps_per_chunk and len(one.identity) == 64
    assert field.config == TOY and field.notices == field.bad == ()


@pytest.mark.long
def test_the_untrained_take_part_when_asked_for(home: Path):
    field = read_field([str(home / "ten")], every=5, untrained=True)
    assert [seat.entrant.label for seat in field.seats[DEFENDER]] == ["ten 0", "ten 5", "ten 10"]
    assert (field.seats[ATTACKER][0].entrant.chunk, field.seats[ATTACKER][0].entrant.steps) == (
        0,
        0,
    )


def test_every_nth_chunk_and_the_last(home: Path):
    assert labels([home / "ten"], ATTACKER, every=4) == ["ten 4", "ten 8", "ten 10"]
    assert labels([home / "ten"], DEFENDER, every=99) == ["ten 10"]


def test_of_several_seeds_each_is_a_run_of_its_own(home: Path):
    field = read_field([str(home / "two")])
    assert [seat.entrant.label for seat in field.seats[0]] == [
        "two/4 1",
        "two/5 1",
        "two/4 2",
        "two/5 2",
    ]
    assert {seat.entrant.run for seat in field.seats[1]} == {"two/4", "two/5"}


def test_the_policies_are_those_of_the_checkpoint(home: Path):
    field = read_field([str(home / "ten")])
    saved, _ = policy_of_run(
        load_run(home / "ten", chunk=7), RunDirectory(home / "ten"), "attacker", None
    )
    player = field.seats[ATTACKER][6].player
    assert player is not None and isinstance(player.pilot, Policy) and isinstance(saved, Policy)
    flown = player.pilot
    for mine, theirs in zip(flown.network.weights, saved.network.weights, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_array_equal(flown.observation_scaler.mean, saved.observation_scaler.mean)
    np.testing.assert_array_equal(flown.log_std, saved.log_std)


def test_the_same_content_is_flown_once_with_a_notice(home: Path, tmp_path: Path):
    """An exported policy and a copy of a run bring nobody new."""
    policy, info = policy_of_run(
        load_run(home / "ten", chunk=2), RunDirectory(home / "ten"), "attacker", None
    )
    file = tmp_path / "best.safetensors"
    save_policy(file, policy, info)
    shutil.copytree(home / "ten", tmp_path / "copy")
    field = read_field([str(home / "ten"), str(file), str(tmp_path / "copy"), str(home / "ten")])
    assert [len(side) for side in field.seats] == [10, 10]
    assert field.seats[ATTACKER][1].also == ("copy 2", "best") or field.seats[ATTACKER][1].also == (
        "best",
        "copy 2",
    )
    assert field.seats[DEFENDER][1].also == ("copy 2",)
    assert (
        "10 attackers were saved more than once (such as attacker ten 1 is also copy 1): flown once each"
        in field.notices
    )
    assert len(field.notices) == 2
    entrant = field.seats[ATTACKER][1].entrant  # the file is no further time of training
    assert [(one.label, one.run, one.chunk, one.steps) for one in entrant.also] == [
        ("copy 2", "copy", 2, entrant.steps)
    ]
    few = read_field([str(file), str(home / "ten")])
    assert few.notices == ("attacker ten 2 is also best: flown once",)
    assert few.seats[ATTACKER][0].entrant.label == "ten 2"  # a run's name comes before a file's
    alone = read_field([str(file), "scripted:hover"]).seats[ATTACKER][0].entrant
    assert (alone.label, alone.method, alone.run, alone.chunk) == ("best", EXPORTED, "ten", 2)


def test_scripted_pilots_by_name_and_all():
    field = read_field(["scripted:all", "scripted:dash"])
    assert [seat.entrant.label for seat in field.seats[ATTACKER]] == ["dash", "weave", "high_dive"]
    assert all(
        seat.entrant.method == SCRIPTED and seat.entrant.run == ""
        for side in field.seats
        for seat in side
    )
    error = refusal(["scripted:dahs", "scripted:none"])
    assert (
        error.exit_code == EXIT_CONFIG
        and len(error.message.splitlines()) == 2
        and "high_dive" in error.message
    )
    assert refusal(["scripted:dash"]).message.startswith("no defender takes part")


def test_all_bad_checkpoints_are_listed(bad: Path):
    error = refusal([bad])
    assert error.exit_code == EXIT_DATA
    lines = error.message.splitlines()
    assert len(lines) == 4 and "--skip-bad" in lines[-1]
    assert (
        sum("damaged" in line for line in lines) == 2
        and sum("no checkpoint 14" in line for line in lines) == 1
    )


def test_skipped_ones_keep_their_place_without_a_player(bad: Path):
    field = read_field([str(bad)], skip_bad=True)
    assert len(field.bad) == 3
    for side in field.seats:
        assert [seat.player is None for seat in side] == [
            chunk in (3, 7, 10) for chunk in range(1, 11)
        ]
        assert side[2].entrant.identity == "missing:ten:3" and side[2].entrant.chunk == 3


def test_runs_without_checkpoints_are_listed_too(home: Path, tmp_path: Path):
    empty = tmp_path / "empty"
    (empty / "checkpoints").mkdir(parents=True)
    begun = write_run(tmp_path / "begun", chunks=0)
    error = refusal([empty, begun, tmp_path / "nowhere"])
    assert error.exit_code == EXIT_DATA and len(error.message.splitlines()) == 4
    assert "no chunk of training is done yet" in error.message and "no such run" in error.message


def test_another_game_is_refused_with_what_differs_unless_allowed(home: Path, tmp_path: Path):
    other = write_run(
        tmp_path / "far", replace(TOY, game=replace(TOY.game, reach_radius=0.25)), chunks=2, seed=5
    )
    error = refusal([home / "ten", other])
    assert error.exit_code == EXIT_DATA and "far 1, far 2 trained in another game" in error.message
    assert "game.reach_radius is 0.25 there, 0.5 here" in error.message
    field = read_field([str(home / "ten"), str(other)], allow_mismatch=True)
    assert field.config == TOY and len(field.seats[0]) == 12 and "far 1" in field.notices[0]


def test_a_policy_file_brings_its_own_game_and_side(tmp_path: Path):
    file = tmp_path / "mine.safetensors"
    game = replace(Config(), game=replace(Config().game, episode_steps=77))
    save_policy(file, make_policy(), make_info(game))
    field = read_field([str(file), "scripted:all"])
    assert environment(field.config) == environment(game) and len(field.seats[ATTACKER]) == 4
    assert refusal([file]).message.startswith("no defender takes part")
    assert "ends in .safetensors" in refusal([__file__, "scripted:all"]).message


def test_runs_of_an_edited_scene_do_not_meet_those_of_the_scene_before(home: Path, tmp_path: Path):
    met = environment(TOY) | {"scene.defender.mass": 1.325, "scene.attacker.mass": 1.325}
    other = write_run(tmp_path / "heavy", chunks=2, seed=5, met=met)
    error = refusal([home / "ten", other])
    assert (
        error.exit_code == EXIT_DATA and "heavy 1, heavy 2 trained in another game" in error.message
    )
    assert "scene.attacker.mass is 1.325 there, the package's own here" in error.message
    # The game is that of those for whom it can be flown.
    assert refusal([other, home / "ten"]).message == error.message


def test_a_policy_of_an_own_drone_flies_where_its_mjcf_is_named(tmp_path: Path):
    """By a run of that drone, in any place, or by its file; else it is said what differs."""
    own = replace(TOY, sim=SimConfig(mjcf=str(write(tmp_path))))
    run = write_run(tmp_path / "own", own, chunks=1)
    file = tmp_path / "mine.safetensors"
    save_policy(file, make_policy(), make_info(own))
    for words in ([file, run], [run, file], [file, "scripted:all", run]):
        field = read_field([str(word) for word in words])
        assert field.config.sim == own.sim and field.notices == ()
    error = refusal([file, "scripted:all"])
    assert "scene.attacker.inertia is [2.3951e-05, 2.3951e-05, 3.2347e-05] there" in error.message
    assert (
        "tournament --mjcf FILE names the MJCF or TOML that they were trained with" in error.message
    )
    moved = write(tmp_path, name="moved.xml")
    (tmp_path / "drone.xml").unlink()
    for words in ([file, "scripted:all"], [run]):
        assert read_field([str(word) for word in words], mjcf=str(moved)).config.sim.mjcf == str(
            moved
        )
    assert refusal([run]).message.startswith(f"sim.mjcf: {tmp_path / 'drone.xml'}: no such file")


def test_a_policy_of_an_own_body_flies_where_its_toml_is_named(tmp_path: Path):
    """As with an MJCF: mass and rotors are the game, the file's place is not."""
    body: Any = str(write_body(tmp_path, lag_up="0.05"))
    own = replace(TOY, sim=SimConfig(body=body, actuation="rotors"))
    run = write_run(tmp_path / "own", own, chunks=1)
    file = tmp_path / "mine.safetensors"
    save_policy(file, make_policy(), make_info(own))
    field = read_field([str(file), str(run)])
    assert field.config.sim == own.sim and field.notices == ()
    error = refusal([file, "scripted:all"])
    assert "rotors.lag_up is 0.05 there, 0.0691 here" in error.message
    assert "names the MJCF or TOML" in error.message
    moved = str(write_body(tmp_path, "moved.toml", lag_up="0.05"))
    (tmp_path / "body.toml").unlink()
    for words in ([file, "scripted:all"], [run]):
        assert read_field([str(word) for word in words], mjcf=moved).config.sim.body == moved
    assert "body.toml: no such file" in refusal([run]).message


def test_in_solo_there_is_no_fight(tmp_path: Path):
    solo = write_run(
        tmp_path / "solo", replace(TOY, game=replace(TOY.game, scenario="solo")), chunks=1
    )
    assert "nobody defends" in refusal([solo, "scripted:all"]).message
    assert [contender.role for contender in find(str(solo)).contenders] == [ATTACKER]


def test_two_runs_of_one_name_cannot_be_told_apart(home: Path, tmp_path: Path):
    other = write_run(tmp_path / "ten", chunks=1, seed=9)
    assert "two different players are called ten 1" in refusal([home / "ten", other]).message
