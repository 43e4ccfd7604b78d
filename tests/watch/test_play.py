"""`dronecombat play`: whom a person flies against, on which side, and what the page is given."""

import base64
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drones import BIG, write
from policies import SIZES, make_info, make_policy
from saved_runs import TOY, write_run

from dronecombat_jax.config.fields import Config
from dronecombat_jax.errors import EXIT_CANNOT_WRITE, EXIT_CONFIG, EXIT_DATA, UserError
from dronecombat_jax.policies.file import save_policy
from dronecombat_jax.sim.scene import load_scene
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause
from dronecombat_jax.watch import play as room
from dronecombat_jax.watch.flyers import read_opponents


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """runs/toy with chunks 0 to 2, runs/solo, two policy files of the toy game."""
    home = tmp_path_factory.mktemp("home")
    write_run(home / "runs" / "toy", chunks=2)
    solo = replace(TOY, game=replace(TOY.game, scenario="solo"))
    write_run(home / "runs" / "solo", solo, chunks=range(1, 2))
    for role in ("defender", "attacker"):
        info = make_info(TOY, role=role, layer_sizes=SIZES)
        save_policy(home / f"{role}.safetensors", make_policy(), info)
    return home


@pytest.fixture(autouse=True)
def at_home(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(home)


def data_in(path: Path) -> dict:
    (call,) = re.findall(r'^dronecombatPlay\("play", (.*)\);</script>$', path.read_text(), re.M)
    return json.loads(call)


@pytest.mark.parametrize(
    ("word", "side", "person", "labels"),
    [
        ("toy", "", ATTACKER, ["toy chunk 2", "toy chunk 2"]),
        ("runs/toy:1", "defender", DEFENDER, ["toy chunk 1", "toy chunk 1"]),
        ("attacker.safetensors", "", DEFENDER, [None, "attacker"]),
        ("defender.safetensors", "attacker", ATTACKER, ["defender", None]),
        ("scripted:dash", "", DEFENDER, [None, "dash (scripted)"]),
        ("scripted:hover_guard", "", ATTACKER, ["hover_guard (scripted)", None]),
    ],
)
def test_words_name_the_opponent(word: str, side: str, person: int, labels: list):
    data = room.play_data(read_opponents((word,)), side)
    assert [pilot and pilot["label"] for pilot in data["opponents"]] == labels
    assert data["side"] == person
    assert data["title"] == f"Fly against {labels[1 - person]}"


def test_the_page_lies_in_the_run(home: Path, capsys: pytest.CaptureFixture[str]):
    assert room.play(("toy",)) == 0
    data = data_in(home / "runs" / "toy" / "play.html")
    assert data["game"]["rules"]["episode_steps"] == TOY.game.episode_steps
    assert "runs/toy/play.html" in capsys.readouterr().out
    assert room.play(("scripted:dash",)) == 0 and (home / "play.html").is_file()


def test_a_name_cannot_leave_the_data(home: Path):
    name = "</script><script>alert(1)</script>"
    folder = home / "runs" / "hostile"
    folder.mkdir(exist_ok=True)
    for role in ("attacker",):
        info = make_info(TOY, role=role, layer_sizes=SIZES)
        save_policy(folder / "a.safetensors", make_policy(), info, force=True)
    opponents = read_opponents((str(folder / "a.safetensors"),))
    flyer = opponents.flyers[ATTACKER]
    assert flyer is not None
    hostile = opponents._replace(flyers=(None, flyer._replace(label=name)))
    text = room.page(room.play_data(hostile))
    assert text.count("<script") == 1 and text.count("</script") == 1


def test_a_policys_numbers_are_in_their_order():
    policy = make_policy()
    pilot = room.play_data(read_opponents(("attacker.safetensors",)))["opponents"][ATTACKER]
    numbers = np.frombuffer(base64.b64decode(pilot["numbers"]), "<f4")
    assert pilot["sizes"] == list(SIZES) and pilot["clip"] == 5.0 and pilot["normalize"] is True
    np.testing.assert_array_equal(numbers[:35], policy.observation_scaler.mean)
    np.testing.assert_allclose(numbers[35:70], policy.observation_scaler.variance**0.5, rtol=1e-6)
    first = numbers[70 : 70 + SIZES[0] * SIZES[1]].reshape(SIZES[:2])
    np.testing.assert_array_equal(first, policy.network.weights[0])
    np.testing.assert_array_equal(numbers[-4:], policy.network.biases[-1])


def test_a_drone_of_ones_own_is_in_the_data(tmp_path: Path):
    path = write(tmp_path, BIG)
    sim = replace(Config().sim, mjcf=str(path), timestep=0.004)
    scene = load_scene(sim)
    opponents = read_opponents(("scripted:dash",))._replace(config=replace(Config(), sim=sim))
    flight = room.play_data(opponents)["game"]["flight"]
    body = flight["bodies"][ATTACKER]
    assert body["mass"] == scene.mass[ATTACKER] and body["drag"]["linear"]["viscous"][0] > 0.0
    assert scene.axes is not None
    np.testing.assert_array_equal(body["axes"], scene.axes[ATTACKER])


def test_drones_with_rotors_are_refused_in_one_line():
    opponents = read_opponents(("scripted:dash",))
    real = replace(Config(), sim=replace(Config().sim, body="firmware", actuation="rotors"))
    with pytest.raises(UserError, match="ideal rigid bodies alone") as raised:
        room.play_data(opponents._replace(config=real))
    assert raised.value.exit_code == EXIT_CONFIG and "\n" not in raised.value.message


def test_every_end_has_its_sentence():
    ends = room.play_data(read_opponents(("scripted:dash",)))["game"]["ends"]
    assert len(ends) == len(Cause)
    assert ends[Cause.REACHED] == {
        "winner": "attacker",
        "sentence": "Attacker wins: it reaches the target",
    }


@pytest.mark.parametrize(
    ("words", "side", "code", "message"),
    [
        ("toy toy", "", EXIT_CONFIG, "name one opponent, not 2: RUN, RUN:CHUNK"),
        ("attacker.safetensors", "attacker", EXIT_CONFIG,
         "--side attacker: attacker flies the attacker; fly the defender against it"),
        ("solo", "", EXIT_CONFIG, "game.scenario = solo: a person needs somebody to fly against"),
        ("nowhere", "", EXIT_DATA, "nowhere: no such run"),
        ("toy:7", "", EXIT_DATA, "no checkpoint 14 in runs/toy"),
        ("scripted:nobody", "", EXIT_CONFIG, "nobody"),
    ],
)  # fmt: skip
def test_mistakes(words: str, side: str, code: int, message: str):
    with pytest.raises(UserError, match=re.escape(message)) as raised:
        room.play(tuple(words.split()), side=side)
    assert raised.value.exit_code == code and "\n" not in raised.value.message


def test_a_page_is_html_and_its_place_can_be_written(home: Path):
    with pytest.raises(UserError, match=r"play\.gif: the page ends in \.html"):
        room.play(("scripted:dash",), out=Path("play.gif"))
    with pytest.raises(UserError) as raised:
        room.play(("scripted:dash",), out=home / "attacker.safetensors" / "play.html")
    assert raised.value.exit_code == EXIT_CANNOT_WRITE


def test_a_planner_is_refused_by_the_page():
    with pytest.raises(UserError, match=r"evasion_planner looks ahead, which the page's own code"):
        room.play_data(read_opponents(("scripted:evasion_planner",)))


def test_a_pilot_of_a_team_is_refused_by_the_page():
    with pytest.raises(
        UserError, match=r"^decoy flies with team mates, and the page has one drone"
    ):
        room.play_data(read_opponents(("scripted:decoy",)))


@pytest.mark.parametrize("field", ["scenario", "observation"])
def test_parts_of_ones_own_are_refused(field: str, tmp_path: Path, monkeypatch):
    code = "from dronecombat_jax.combat.games import DUEL\n"
    code += "from dronecombat_jax.combat.observe import OBSERVATIONS\n"
    code += "SCENARIO = DUEL._replace(flies=(True, True), judge=lambda *_: 0)\n"
    code += "OBSERVATION = OBSERVATIONS['ego']\n"
    (tmp_path / "own_part.py").write_text(code)
    monkeypatch.chdir(tmp_path)
    game = replace(Config().game, **{field: f"own_part:{field.upper()}"})
    opponents = read_opponents(("scripted:dash",))._replace(config=replace(Config(), game=game))
    with pytest.raises(UserError, match=rf"game\.{field} = own_part:{field.upper()}: the page"):
        room.play_data(opponents)
