"""The ladder of the package, a stranger's policy on it, and files that are refused."""

import importlib.util
import json
import re
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import policy_files
import pytest
from policies import make_info, make_policy
from refusals import refused
from saved_runs import TOY, write_run
from tournaments import from_letters

from dronecombat_jax import rate
from dronecombat_jax.combat.fingerprint import environment_digest
from dronecombat_jax.config import settings
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA, UserError
from dronecombat_jax.policies import shipped
from dronecombat_jax.policies.file import save_policy
from dronecombat_jax.tournaments import newcomers
from dronecombat_jax.tournaments.contenders import find
from dronecombat_jax.tournaments.ladder import LADDERS, Ladder, ladder_text, read_ladder, standing
from dronecombat_jax.tournaments.newcomers import rated_text
from dronecombat_jax.types import SIDES

ROOT = Path(__file__).parents[2]


def script(path: str) -> ModuleType:
    """A program of the repository that is no part of the package."""
    spec = importlib.util.spec_from_file_location(Path(path).stem, ROOT / path)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("spawn", LADDERS)
def test_a_ladder_of_the_package_is_of_this_version_and_of_its_pilots(spawn):
    ladder = read_ladder(spawn)
    assert ladder.spawn == spawn and ladder.environment_sha256 == environment_digest(
        settings.load(ladder.preset)
    )
    everybody = [one for word in ("pilots:all", "scripted:all") for one in find(word).contenders]
    known = {(SIDES[one.role], one.entrant.identity) for one in everybody}
    assert {(rung.role, rung.identity) for rung in ladder.rungs} == known
    names = [name for rung in ladder.rungs if not rung.scripted for name in (rung.name, *rung.also)]
    assert sorted(names) == sorted(shipped.names())
    # the gauge
    assert np.mean([rung.rating for rung in ladder.rungs]) == pytest.approx(1500.0, abs=0.01)
    for role in SIDES:
        ratings = [rung.rating for rung in ladder.side(role)]
        assert ratings == sorted(ratings, reverse=True)


def test_the_page_and_the_cards_say_what_the_ladder_says():
    made, ladder = script("experiments/make_ladder.py"), read_ladder()
    for each in (ladder, read_ladder("even")):
        assert made.standing_page(each) in (ROOT / "docs/ladder.md").read_text()
    assert made.cards(ladder) == json.loads((shipped.FOLDER / shipped.CARDS).read_text())


def test_a_standing_is_written_and_read_again(tmp_path, monkeypatch):
    result = from_letters([["www", "wdl"], ["lll", "wwl"], ["ddd", "lll"]])
    first = result.defenders[0].identity
    ladder = Ladder("duel", "0" * 64, 5, 0, standing(result, {first: ("another",)}))
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    (tmp_path / "ladder.json").write_text(ladder_text(ladder))
    again = read_ladder()
    assert [rung.name for rung in again.rungs] == [rung.name for rung in ladder.rungs]
    assert [rung.also for rung in again.rungs if rung.identity == first] == [("another",)]
    for rung, before in zip(again.rungs, ladder.rungs, strict=True):
        assert rung.rating == pytest.approx(before.rating, abs=0.005)
        assert all(share < 0.5 for _, share in rung.worst)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (None, "this package holds no ladder"),
        ("{", "damaged or no ladder"),
        ('{"format": 1, "rungs": [{}]}', "damaged or no ladder"),
        ('{"format": 99}', "has format 99: upgrade"),
    ],
)
def test_a_ladder_that_cannot_be_read_is_one_line(text, told, tmp_path, monkeypatch):
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    if text is not None:
        (tmp_path / "ladder.json").write_text(text)
    with pytest.raises(UserError, match=told) as error:
        read_ladder()
    assert error.value.exit_code == EXIT_DATA and "\n" not in error.value.message


@pytest.mark.long
def test_a_strangers_policy_of_another_network_and_frame_gets_the_same_digits_twice(tmp_path):
    file = script("examples/write_your_policy.py").main(str(tmp_path / "stranger.safetensors"))
    (one,), (again,) = (rate(file, fights=3) for _ in range(2))
    assert one == again and one.role == "attacker" and one.notes == ()
    opponents = len(read_ladder().side("defender"))
    assert one.fights == 3 * opponents and one.places == len(read_ladder().side("attacker")) + 1
    # who draws its weights from a hat loses to nearly everybody
    assert one.score < 0.3 and one.place >= one.places - 3 and len(one.worst) == 3
    assert re.match(
        r"attacker stranger: rating \d+\.\d, 95 % \[(never scored|\d+\.\d), \d+\.\d\], place \d+ of 47\n",
        rated_text(one),
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ippo-defender-27", "sippo-attacker-20"])
def test_a_pilot_of_the_ladder_flown_anew_gets_its_rating(name):
    """The tests' compiler rounds last bits otherwise: a few of some 2,000 fights end otherwise."""
    (rung,) = (rung for rung in read_ladder().rungs if rung.name == name)
    (again,) = rate(f"pilots:{name}")
    assert again.rating == pytest.approx(rung.rating, abs=5.0)
    assert (again.low, again.high) == pytest.approx((rung.low, rung.high), abs=8.0)
    assert again.place == 1 + read_ladder().side(rung.role).index(rung)


def test_a_policy_of_another_game_is_rated_on_request_alone(tmp_path, even):
    file = tmp_path / "other.safetensors"
    other = settings.load("duel", {"game.intercept_radius": 0.3, "game.observation": "ego"})
    save_policy(file, make_policy(), make_info(other))
    line = (
        r"other was trained in another game than the ladder's, preset duel: game.intercept_radius"
    )
    with pytest.raises(UserError, match=line) as error:
        rate(file)
    assert error.value.exit_code == EXIT_DATA and "observation" not in error.value.message
    (one,) = rate(file, allow_env_mismatch=True)
    assert "intercept_radius is 0.3 there" in one.notes[0] and one.score == 0.5


@pytest.fixture
def even(monkeypatch) -> None:
    """Every fight ends in a tie, and none is flown."""
    tied = lambda combat, side, players, opponents, rules: np.full(
        (len(players), len(opponents), rules.episodes), 0.5
    )
    monkeypatch.setattr(newcomers, "_fly", tied)


@pytest.mark.long
def test_of_a_run_the_newest_of_both_sides_and_all_seeds_is_rated(tmp_path, even):
    two = replace(TOY, train=replace(TOY.train, num_seeds=2))
    run = write_run(tmp_path / "pair", two, chunks=3)
    rated = rate(run, allow_env_mismatch=True)
    assert [(one.name, one.role) for one in rated] == [
        (f"pair/{seed} 3", role) for seed in (4, 5) for role in SIDES
    ]
    sides = [len(read_ladder().side(role)) for role in SIDES]
    assert [one.places for one in rated] == [size + 1 for size in sides] * 2
    (alone,) = rate(write_run(tmp_path / "one"), role="attacker", allow_env_mismatch=True)
    assert (alone.name, alone.role) == ("one 3", "attacker")


def test_of_the_ladders_own_players_each_is_counted_once(even):
    (one,) = rate("scripted:weave")
    assert one.places == len(read_ladder().side("attacker")) and one.worst == ()
    (twin,) = rate("pilots:sippo-attacker-3")  # of the same content as ippo-attacker-3
    assert twin.places == one.places


def test_on_the_ladder_from_even_starts_the_defender_starts_farther_back(monkeypatch):
    setbacks = []

    def flown(combat, side, players, opponents, rules):
        setbacks.append(combat.config.game.defender_setback)
        return np.full((len(players), len(opponents), rules.episodes), 0.5)

    monkeypatch.setattr(newcomers, "_fly", flown)
    (rested,), (even,) = (rate("scripted:weave", spawn=spawn) for spawn in LADDERS)
    assert setbacks == [0.0, 2.0] and rested.rating != even.rating
    with pytest.raises(UserError, match="--spawn sideways: expected one of as_trained, even"):
        rate("scripted:weave", spawn="sideways")


def test_a_run_without_a_chunk_and_a_side_that_never_flew_are_one_line(tmp_path):
    with pytest.raises(UserError, match="no chunk of training is done yet"):
        rate(write_run(tmp_path / "begun", chunks=0))
    solo = replace(TOY, game=replace(TOY.game, scenario="solo"))
    with pytest.raises(UserError, match="flies as attacker alone, not as defender"):
        rate(write_run(tmp_path / "solo", solo), role="defender")


def planted(**tensors) -> dict:
    return {"tensors": tensors}


BAD = {
    "nothing there": (None, "No such file"),
    "empty": (b"", "0 bytes"),
    "text": (b"these are no weights at all", "damaged or no safetensors file"),
    "cut short": (0.5, "damaged or no safetensors file"),
    "no metadata": ({"metadata": {"format": None}}, "no policy of dronecombat"),
    "of a later format": ({"metadata": {"format_version": "9"}}, "upgrade dronecombat-jax"),
    "no role": ({"metadata": {"role": "referee"}}, "metadata role is referee"),
    "no environment": ({"metadata": {"environment": "[]"}}, "metadata environment is []"),
    "NaN": (planted(log_std=np.full(4, np.nan, np.float32)), "NaN or infinity in log_std"),
    "wrong shape": (
        planted(**{"weights.1": np.zeros((7, 8), np.float32)}),
        "weights.1: expected float32[16,8], got float32[7,8]",
    ),
    "a layer short": (planted(**{"biases.2": None}), "biases.2: expected float32[4], got nothing"),
    "other observation size": ({"metadata": {"layer_sizes": "[34, 16, 8, 4]"}}, "expected 35"),
    "other action size": ({"metadata": {"layer_sizes": "[35, 16, 8, 3]"}}, "layer_sizes is"),
    "other action": ({"metadata": {"action_fields": '["rotor_1"]'}}, "action_fields is"),
    "changed": ({"metadata": {"sha256": "0" * 64}}, "its sha256 does not match"),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_files_are_refused_in_one_line(kind, tmp_path, capsys):
    content, told = BAD[kind]
    file = tmp_path / "bad.safetensors"
    if isinstance(content, dict):
        policy_files.write(file, **content)
    elif isinstance(content, float):
        whole = policy_files.write(file).read_bytes()
        file.write_bytes(whole[: int(content * len(whole))])
    elif content is not None:
        file.write_bytes(content)
    (line,) = refused(capsys, "rate", str(file), "--device", "cpu", code=EXIT_DATA)
    assert "bad.safetensors" in line and told in line


@pytest.mark.parametrize(
    ("args", "told", "code"),
    [
        ((), "POLICY is missing", EXIT_CONFIG),
        (("good.safetensors", "--role", "defender"), "flies as attacker alone", EXIT_CONFIG),
        (("good.onnx",), "a policy file ends in .safetensors", EXIT_CONFIG),
        (("no-run",), "no-run: no such run", EXIT_DATA),
        (("pilots:nobody",), "no pilot has this name", EXIT_CONFIG),
        (("scripted:nobody",), "no scripted pilot has this name", EXIT_CONFIG),
        (("good.safetensors", "--fights", "-1"), "--fights", EXIT_CONFIG),
    ],
)
def test_words_that_name_nobody_are_refused_in_one_line(
    args, told, code, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    policy_files.write(Path("good.safetensors"))
    Path("good.onnx").write_bytes(b"")
    (line,) = refused(capsys, "rate", *args, code=code)
    assert told in line
