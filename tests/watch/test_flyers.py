"""Who flies a replay, as named on the command line; every mistake is one line."""

import os
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest
from policies import SIZES, make_info, make_policy
from saved_runs import TOY, damage, write_run

from dronecombat_jax.arena.match import policy_pilot
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.fingerprint import environment
from dronecombat_jax.combat.observe import observation_of
from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config, SensorConfig
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA, UserError
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.policies.file import save_policy
from dronecombat_jax.types import SIDES, Policy
from dronecombat_jax.watch.flyers import Named, chunks_along, last_run, of_run, read_crew


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """runs/toy with chunks 0 to 3, runs/other with chunk 1, two policy files of the toy game."""
    home = tmp_path_factory.mktemp("home")
    write_run(home / "runs" / "toy")
    write_run(home / "runs" / "other", chunks=range(1, 2), seed=1)
    for index, role in enumerate(("defender", "attacker")):
        info = make_info(TOY, role=role, layer_sizes=SIZES)
        save_policy(home / f"{role}.safetensors", make_policy(seed=index), info)
    return home


@pytest.fixture(autouse=True)
def at_home(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(home)


@pytest.mark.parametrize(
    ("words", "wanted", "labels"),
    [
        ("toy", ("", ""), ("toy chunk 3", "toy chunk 3")),
        ("runs/toy", ("1", "0"), ("toy chunk 1", "toy chunk 0")),
        ("toy", ("hover_guard", ""), ("hover_guard (scripted)", "toy chunk 3")),
        ("toy", ("", "scripted:weave"), ("toy chunk 3", "weave (scripted)")),
        ("toy", ("other", "other:1"), ("other chunk 1", "other chunk 1")),
        ("toy attacker.safetensors", ("", ""), ("toy chunk 3", "attacker")),
        ("attacker.safetensors defender.safetensors", ("", ""), ("defender", "attacker")),
        ("attacker.safetensors", ("hover", ""), ("hover (scripted)", "attacker")),
        ("toy", ("defender.safetensors", ""), ("defender", "toy chunk 3")),
        ("scripted:dash scripted:hover", ("", ""), ("hover (scripted)", "dash (scripted)")),
        ("", ("hover", "dash"), ("hover (scripted)", "dash (scripted)")),
        ("", ("2", ""), ("toy chunk 2", "toy chunk 3")),
        ("", ("", ""), ("toy chunk 3", "toy chunk 3")),
    ],
)
def test_words_name_both_sides(words: str, wanted: tuple[str, str], labels: tuple[str, str]):
    os.utime("runs/other/checkpoints", (1, 1))  # the toy run saved last
    crew = read_crew(Named(tuple(words.split()), wanted))
    assert tuple(flyer.label for flyer in crew.flyers) == labels
    scripted_alone = all("scripted" in label for label in labels)
    assert environment(crew.config) == environment(settings.load("duel") if scripted_alone else TOY)


def test_a_runs_policy_is_that_of_its_checkpoint(home: Path):
    run = RunDirectory(home / "runs" / "toy")
    flyers = [of_run(run, 1, chunk, -1) for chunk in (0, 2, None)]
    # 48 steps an iteration
    assert [(flyer.chunk, flyer.steps) for flyer in flyers] == [(0, 0), (2, 192), (3, 288)]
    weights = [
        np.asarray(flyer.pilot.network.weights[0])
        for flyer in flyers
        if isinstance(flyer.pilot, Policy)
    ]
    assert (
        not np.array_equal(weights[0], weights[1])
        and len({flyer.identity for flyer in flyers}) == 3
    )


@pytest.mark.parametrize(
    ("words", "wanted", "code", "message"),
    [
        ("toy other", ("", ""), EXIT_CONFIG, "other: a second run; name its player with a flag"),
        ("attacker.safetensors", ("", ""), EXIT_CONFIG, "no defender is named"),
        ("attacker.safetensors scripted:dash", ("", ""), EXIT_CONFIG, "two attackers are named"),
        ("toy scripted:all", ("", ""), EXIT_CONFIG, "name one pilot"),
        ("toy", ("dash", ""), EXIT_CONFIG, "--defender dash: it is a policy of the attacker"),
        ("toy", ("", "defender.safetensors"), EXIT_CONFIG, "it is a policy of the defender"),
        (
            "toy",
            ("hovr", ""),
            EXIT_CONFIG,
            r"--defender hovr: no chunk number, no scripted pilot \(hover, ",
        ),
        ("toy", ("9", ""), EXIT_DATA, "no checkpoint 18"),
        ("attacker.safetensors", ("4", ""), EXIT_CONFIG, "a chunk number needs a RUN"),
        ("tay", ("", ""), EXIT_DATA, "did you mean toy"),
        ("none.safetensors", ("", ""), EXIT_DATA, "none.safetensors"),
    ],
)
def test_mistakes_are_one_line(words: str, wanted: tuple[str, str], code: int, message: str):
    with pytest.raises(UserError, match=message) as raised:
        read_crew(Named(tuple(words.split()), wanted))
    assert raised.value.exit_code == code and "\n" not in raised.value.message


def test_seeds_of_a_run(tmp_path: Path):
    config = replace(TOY, train=replace(TOY.train, num_seeds=2, seed=4))
    run = write_run(tmp_path / "two", config, chunks=1)
    labels = [read_crew(Named((str(run),), run_seed=seed)).flyers[1].label for seed in (-1, 4, 5)]
    assert labels == ["two/4 chunk 1", "two/4 chunk 1", "two/5 chunk 1"]
    with pytest.raises(UserError, match="has seeds 4 to 5, not 6"):
        read_crew(Named((str(run),), run_seed=6))


def test_policies_of_another_game_fly_only_when_allowed(home: Path, tmp_path: Path):
    info = make_info(
        replace(TOY, game=replace(TOY.game, reach_radius=0.25)), role="attacker", layer_sizes=SIZES
    )
    save_policy(tmp_path / "near.safetensors", make_policy(), info)
    words = ("toy", str(tmp_path / "near.safetensors"))
    with pytest.raises(
        UserError, match=r"near was trained in another game: game.reach_radius is 0.25 there"
    ):
        read_crew(Named(words))
    crew = read_crew(Named(words, allow_mismatch=True))
    assert environment(crew.config) == environment(TOY)


@pytest.mark.long
def test_sight_may_differ_where_the_numbers_are_as_many(tmp_path: Path):
    """A camera of 90 degrees flies with one that sees all round; four slots do not fit two."""

    def crew(name: str, first: Config, second: Config):
        words = [str(tmp_path / f"{name}-{role}.safetensors") for role in SIDES]
        for word, role, config in zip(words, SIDES, (first, second), strict=True):
            sizes = (observation_of(config).size, 16, 8, 4)
            info = make_info(config, role=role, layer_sizes=sizes)
            save_policy(Path(word), make_policy(sizes), info)
        return read_crew(Named(tuple(words), allow_mismatch=True))

    seen = lambda name, **game: replace(TOY, game=replace(TOY.game, observation=name, **game))
    narrow = replace(seen("bearing"), sensor=SensorConfig(field_of_view=90.0))
    both = crew("camera", seen("bearing"), narrow)
    assert both.config.sensor == SensorConfig()
    combat = Combat(both.config)
    state = jax.vmap(combat.reset)(jax.random.split(jax.random.key(0), 3))
    observed = jax.vmap(combat.observe)(state)
    for role, flyer in enumerate(both.flyers):
        pilot = policy_pilot(flyer.learn, flyer.pilot, role)
        assert callable(pilot)
        action = pilot(state, observed, jax.random.key(1))
        assert action.shape == (3, 4) and np.isfinite(action).all()
    crew("alike", seen("nearest", nearest_k=4), seen("nearest", nearest_k=4))
    with pytest.raises(
        UserError, match="sees 99 numbers, and observation nearest of this game has 59"
    ):
        crew("slots", seen("nearest"), seen("nearest", nearest_k=4))


def test_in_a_solo_run_nobody_can_defend(tmp_path: Path):
    config = replace(TOY, game=replace(TOY.game, scenario="solo"))
    run = str(write_run(tmp_path / "solo", config, chunks=1))
    assert read_crew(Named((run,))).flyers[1].label == "solo chunk 1"
    with pytest.raises(UserError, match="flies alone"):
        read_crew(Named((run,), ("hover", "")))


@pytest.mark.parametrize(
    ("chunks", "along"),
    [
        (range(0, 4), [(0, 0), (33, 1), (67, 2), (100, 3)]),
        (range(5, 6), [(100, 5)]),
        (range(0, 1), [(0, 0)]),
        (range(0, 21), [(10 * part, 2 * part) for part in range(11)]),
    ],
)
def test_the_chunks_along_a_training(chunks: range, along: list, tmp_path: Path):
    for chunk in chunks:
        (tmp_path / "run" / "checkpoints" / str(chunk * TOY.train.chunk_iterations)).mkdir(
            parents=True
        )
    last = chunks[-1] * TOY.train.chunk_iterations
    (tmp_path / "run" / "checkpoints" / str(last)).rmdir()
    write_run(tmp_path / "run", chunks=range(chunks[-1], chunks[-1] + 1))
    assert chunks_along(RunDirectory(tmp_path / "run")) == along


def test_the_last_run_is_the_one_that_saved_last(tmp_path: Path):
    assert last_run(tmp_path) is None
    for name, time in (("a", 300), ("b", 400), ("c", 200)):
        (tmp_path / name / "checkpoints").mkdir(parents=True)
        os.utime(tmp_path / name / "checkpoints", (time, time))
    (tmp_path / "notes").mkdir()
    newest = last_run(tmp_path)
    assert newest is not None and newest.path == tmp_path / "b"


def test_a_damaged_checkpoint_is_named(tmp_path: Path):
    run = write_run(tmp_path / "run", chunks=2)
    damage(run, 1)
    with pytest.raises(UserError) as raised:
        read_crew(Named((str(run),), ("1", "")))
    assert raised.value.exit_code == EXIT_DATA
