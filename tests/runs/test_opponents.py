"""Frozen policies that a run trains against: named in many ways, kept in its folder, proven."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest
from policies import make_info, make_policy
from saved_runs import TOY, write_run
from tiny import CHUNK, COMMAND, STEPS, finish
from tiny import train as begin
from toy_training import ToyState

from dronecombat_jax.combat.sensors import view_of
from dronecombat_jax.config import flags, settings
from dronecombat_jax.config.fields import Config, SelfPlayConfig
from dronecombat_jax.config.opponents import table
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA, UserError
from dronecombat_jax.files import checkpoint, metrics
from dronecombat_jax.files.claim import claim_run
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.learn.rollout import policy_mean
from dronecombat_jax.policies.file import load_policy, save_policy
from dronecombat_jax.runs.evaluation import Match, flown_by, load_run, play, shown_to
from dronecombat_jax.runs.export import export
from dronecombat_jax.runs.opponents import keep, kept_policy, read_kept, read_named
from dronecombat_jax.runs.progress import Progress
from dronecombat_jax.runs.saving import Saver
from dronecombat_jax.types import ATTACKER, DEFENDER
from dronecombat_jax.watch.finish import record_fights
from dronecombat_jax.watch.flyers import Named, of_run, read_crew, read_opponents
from dronecombat_jax.watch.play import play_data


@pytest.fixture(scope="module")
def home(tmp_path_factory) -> Path:
    """A folder with a run of two seeds and a policy file of each side."""
    root = tmp_path_factory.mktemp("opponents")
    write_run(root / "old", replace(TOY, train=replace(TOY.train, num_seeds=2)))
    for role in ("defender", "attacker"):
        export(root / "old", root / f"{role}.safetensors", role, seed=4)
    return root


def against(text: str) -> Config:
    return replace(TOY, selfplay=SelfPlayConfig(opponents=text))


def same(a, b) -> bool:
    pairs = zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    return all(np.array_equal(x, y) for x, y in pairs)


def test_a_file_a_run_and_one_of_its_chunks_can_be_named(home):
    old = lambda chunk: load_run(home / "old", chunk)
    expected = load_policy(home / "defender.safetensors").policy
    for word in (f"{home}/defender.safetensors", f"{home}/old", f"{home}/old:3"):
        frozen = read_named(against(f"defender={word} 0.5"))
        assert same(frozen.saved[f"defender={word}"].policy, expected)
        assert "seed 4, chunk 3" in frozen.lines[0]
    first = read_named(against(f"defender={home}/old:0 0.5"))
    assert same(first.saved[f"defender={home}/old:0"].policy, flown_by(old(0), 0)[DEFENDER])
    assert not same(first.saved[f"defender={home}/old:0"].policy, expected)


@pytest.mark.parametrize(
    ("row", "code", "message"),
    [
        ("defender={home}/attacker.safetensors", EXIT_CONFIG, "it is a policy of the attacker"),
        ("attacker=scripted:hover", EXIT_CONFIG, "no scripted attacker has this name (dash, "),
        ("attacker=pilots:nobody", EXIT_CONFIG, "no pilot has this name"),
        ("attacker=pilots:all", EXIT_CONFIG, "name one pilot, not all of them"),
        ("attacker={home}/none.safetensors", EXIT_DATA, "cannot be read: No such file"),
        ("attacker={home}/none", EXIT_DATA, "no policy file, no pilots:NAME, no scripted:NAME"),
        ("attacker={home}/old:99", EXIT_DATA, "no checkpoint 198"),
        ("attacker=pilots:ippo-attacker", EXIT_DATA, "was trained in another game: game."),
    ],
)
def test_who_cannot_be_met_is_refused_in_one_line(home, row, code, message):
    with pytest.raises(UserError) as error:
        read_named(against(row.format(home=home)))
    assert error.value.exit_code == code and message in error.value.message
    assert "\n" not in error.value.message


def test_copies_are_kept_and_proven(home, tmp_path):
    run = RunDirectory(tmp_path)
    config = against(f"defender={home}/defender.safetensors 0.5, attacker={home}/old 0.25")
    frozen = read_named(config)
    keep(run, frozen)
    assert sorted(path.name for path in run.opponents.iterdir()) == [
        "attacker-1.safetensors",
        "defender-1.safetensors",
    ]
    meta = json.loads(json.dumps(frozen.meta))
    kept = read_kept(run, config, meta)
    assert same(kept.cast(config.game), frozen.cast(config.game)) and kept.digests == frozen.digests
    first = table(config)[0]
    assert same(kept_policy(run, config, first).policy, kept.saved[first.name].policy)

    other = read_named(against(f"defender={home}/old:1 0.5"))
    copy = run.opponents / "defender-1.safetensors"
    good = copy.read_bytes()
    keep(run, other)  # a sound file, but another policy
    refused(run, config, meta, "not the opponents that the checkpoint was trained against")
    copy.write_bytes(good[:-1] + b"\x00")
    refused(run, config, meta, "defender-1.safetensors")
    copy.unlink()
    refused(run, config, meta, "the run was trained against it")


def test_a_run_whose_folder_has_gone_takes_its_opponents_along(home, tmp_path):
    """Else it could not go on from where it was rescued to."""
    config = against(f"defender={home}/defender.safetensors")
    config = replace(config, run=replace(config.run, name="gone", directory=str(tmp_path)))
    frozen = read_named(config)
    state = ToyState(iteration=np.array([2], np.int32), history=np.ones(3, np.uint64))
    with claim_run(str(tmp_path), "gone") as run:
        keep(run, frozen)
        saver = Saver(run, config, Progress("gone", 1), frozen.meta)
        saver.frozen = frozen
        shutil.rmtree(run.path)
        saver.save(state)
    assert saver.run.path != run.path
    manifest = checkpoint.verify(saver.run.checkpoints, 2)
    kept = read_kept(saver.run, config, manifest.meta)
    assert same(kept.cast(config.game), frozen.cast(config.game))


def refused(run: RunDirectory, config: Config, meta: dict, message: str) -> None:
    with pytest.raises(UserError) as error:
        read_kept(run, config, meta)
    assert error.value.exit_code == EXIT_DATA
    assert message in error.value.message and "\n" not in error.value.message


@pytest.mark.long
def test_the_frozen_side_is_flown_by_the_opponent_and_is_no_policy_of_the_run(home, tmp_path):
    """In evaluations, films and replays."""
    config = against(f"defender={home}/defender.safetensors")
    write_run(tmp_path / "new", config, chunks=1)
    keep(RunDirectory(tmp_path / "new"), read_named(config))
    run = load_run(tmp_path / "new")
    defender, attacker = flown_by(run, 0)
    assert same(defender, load_policy(home / "defender.safetensors").policy)
    assert same(attacker, flown_by(load_run(tmp_path / "new"), 0)[ATTACKER])
    with pytest.raises(UserError, match="trained against a defender that does not learn"):
        export(tmp_path / "new", tmp_path / "x.safetensors", "defender")
    scripted = against("defender=scripted:hover_guard")
    write_run(tmp_path / "script", scripted, chunks=1)
    run = load_run(tmp_path / "script")
    assert flown_by(run, 0)[DEFENDER] == "hover_guard"
    mine, named = (play(run, 0, Match(4, defender=name)) for name in ("", "hover_guard"))
    np.testing.assert_array_equal(mine.steps, named.steps)


@pytest.mark.long
def test_a_policy_with_another_view_is_met_as_it_saw_in_its_training(tmp_path):
    """In training, evaluations, films, replays and on the page to fly in."""
    file = tmp_path / "made.safetensors"
    save_policy(file, make_policy(), make_info(TOY, role="defender"))
    base = against(f"defender={file}")
    config = replace(base, game=replace(base.game, observation="ego"))
    frozen = read_named(config)
    (guest,) = frozen.cast(config.game).values()
    (at_home,) = read_named(base).cast(base.game).values()
    assert (guest.observation, at_home.observation) == ("world", "")
    write_run(tmp_path / "new", config, chunks=1)
    keep(RunDirectory(tmp_path / "new"), frozen)
    run = load_run(tmp_path / "new")
    assert (shown_to(run, DEFENDER), shown_to(run, ATTACKER)) == ("world", "")
    flyer = of_run(RunDirectory(tmp_path / "new"), DEFENDER, None, -1)
    assert flyer.observation == "world" and flyer.environment
    assert flyer.environment["game.observation"] == "world"
    crew = read_crew(Named((str(tmp_path / "new"),)))
    assert [each.observation for each in crew.flyers] == ["world", ""]
    page = play_data(read_opponents((str(tmp_path / "new"),)))
    assert page["game"]["observation"] == "ego"
    assert [each.get("observation") for each in page["opponents"]] == ["world", None]

    combat, learn = run.combat, run.config.learn
    policy, fights = flown_by(run, 0)[DEFENDER], record_fights(run, 0, 4)
    seen = jax.vmap(combat.observe)(fights.start)
    flown = lambda shown: np.clip(policy_mean(learn, policy, shown[:, DEFENDER]), -1.0, 1.0)
    wanted = flown(view_of(config, "world")(fights.start, seen))
    np.testing.assert_allclose(fights.action[0][:, DEFENDER], wanted, atol=1e-5)
    assert np.abs(wanted - flown(seen)).max() > 1e-3


@pytest.mark.slow
def test_a_run_against_a_file_goes_on_without_the_file_and_comes_to_the_same_bits(tmp_path):
    given, errors = flags.parse(
        Config, list(COMMAND[2:]), "train", aliases={"train.seed": "--seed"}
    )
    assert errors == []
    config = settings.load("smoke", given)
    write_run(tmp_path / "old", config, chunks=1)
    file = tmp_path / "old.safetensors"
    export(tmp_path / "old", file, "attacker", seed=3)
    role = ("--against", str(file), "--role", "defender")
    for name, chunks in (("whole", 4), ("parts", 2)):
        code, out, err = finish(
            begin(tmp_path, name, *role, "--steps", str(chunks * CHUNK * STEPS))
        )
        assert code == 0, err
        assert f"attacker={file}: old, seed 3, chunk 1" in out
    file.unlink()
    code, _, err = finish(begin(tmp_path, "parts", *role, "--steps", str(4 * CHUNK * STEPS)))
    assert code == 0, err
    digests = [
        checkpoint.verify(tmp_path / name / "checkpoints", 4 * CHUNK).digest
        for name in ("whole", "parts")
    ]
    assert digests[0] == digests[1]
    rows = metrics.read(tmp_path / "whole" / "metrics.jsonl")
    met = [f"against/attacker={file}/{name}" for name in ("defender", "draw", "attacker")]
    assert sum(row[key] for row in rows for key in met) == sum(row["episodes"] for row in rows) > 0
    assert all(row["kl/attacker"] is None and row["kl/defender"] is not None for row in rows)
    (tmp_path / "parts" / "opponents" / "attacker-1.safetensors").unlink()
    code, _, err = finish(begin(tmp_path, "parts", *role, "--steps", str(5 * CHUNK * STEPS)))
    (line,) = err.splitlines()
    assert code == EXIT_DATA and "the run was trained against it" in line
