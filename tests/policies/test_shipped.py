"""Pilots that come with the package: names, cards, and that they are found wherever a file is."""

import json
import re

import jax
import numpy as np
import pytest
from policies import SIZES, make_info, make_policy

from dronecombat_jax.cli import commands
from dronecombat_jax.combat.fingerprint import environment, game_diff
from dronecombat_jax.config import settings
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA, UserError
from dronecombat_jax.policies import shipped
from dronecombat_jax.policies.file import save_policy
from dronecombat_jax.tournaments.contenders import find
from dronecombat_jax.types import ATTACKER, DEFENDER, SIDES
from dronecombat_jax.watch.flyers import Named, read_crew, read_opponents

NAMES = ("ippo-attacker-9", "ippo-attacker-34", "ippo-defender-34", "sippo-attacker-34")


@pytest.fixture
def folder(tmp_path, monkeypatch) -> None:
    """Four pilots with their cards in the place of the package's, and no run beside them."""
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    cards = {}
    for seed, name in enumerate((*NAMES, "sippo-defender-34")):
        method, side, chunk = name.split("-")
        changes = {"role": side, "run": method, "chunk": int(chunk), "layer_sizes": SIZES}
        info = make_info(settings.load("duel"), **changes)
        save_policy(tmp_path / f"{name}.safetensors", make_policy(seed=seed), info)
        cards[name] = {
            "trained": f"make train-{method}", "steps": 6_000_000, "rating": 1500.0 + seed,
            "low": 1400.0, "high": 1600.0, "loses_to": ["hover_guard (0.10)"] * (seed % 2),
        }  # fmt: skip
    (tmp_path / shipped.CARDS).write_text(json.dumps(cards))
    monkeypatch.chdir(tmp_path)


def test_names_are_in_order_and_the_newest_needs_no_number(folder):
    assert shipped.names()[:3] == list(NAMES[:3])
    assert [path.stem for path in shipped.paths("ippo-attacker")] == ["ippo-attacker-34"]
    assert [path.stem for path in shipped.paths("ippo-attacker-9")] == ["ippo-attacker-9"]
    assert len(shipped.paths("all")) == 5


def test_they_take_part_in_a_tournament_as_files_do(folder):
    found = find("pilots:all")
    assert found.config is not None and found.config.game == settings.load("duel").game
    assert len(found.contenders) == 5
    sides = [contender.role for contender in found.contenders]
    assert sides == [ATTACKER, ATTACKER, DEFENDER, ATTACKER, DEFENDER]
    (alone,) = find("pilots:ippo-attacker").contenders
    assert alone.entrant.label == "ippo-attacker-34" and alone.entrant.chunk == 34


def test_they_fly_a_replay(folder):
    crew = read_crew(Named(("pilots:ippo-attacker-9",), ("hover", "")))
    assert [flyer.label for flyer in crew.flyers] == ["hover (scripted)", "ippo-attacker-9"]


def test_the_first_replay_needs_no_word_and_is_an_even_fight_of_the_strongest(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    crew = read_crew(Named())
    labels = [re.sub(r"\d+$", "", flyer.label) for flyer in crew.flyers]
    assert labels == ["league-defender-", "strong-attacker-"]
    assert crew.starts == "even"
    assert read_crew(Named(("pilots:ippo-attacker",), ("hover", ""))).starts == ""
    # a person flies against one that can be beaten
    met = read_opponents(()).flyers[DEFENDER]
    assert met is not None and met.label == "sippo-defender-34"


def test_without_pilots_the_first_replay_is_of_scripted_ones(tmp_path, monkeypatch):
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    monkeypatch.chdir(tmp_path)
    labels = [flyer.label for flyer in read_crew(Named()).flyers]
    assert labels == ["proportional_navigation (scripted)", "weave (scripted)"]


def test_a_chunk_still_needs_a_run(folder):
    with pytest.raises(UserError, match="a chunk number needs a RUN"):
        read_crew(Named((), ("5", "")))


def test_an_unknown_name_is_one_line(folder, capsys):
    with pytest.raises(UserError, match="did you mean ippo-attacker") as error:
        shipped.paths("ippo-atacker")
    assert error.value.exit_code == EXIT_CONFIG
    assert commands.main(["pilots", "nobody"]) == EXIT_CONFIG
    assert capsys.readouterr().err.startswith("error: pilots:nobody: no pilot has this name")


def test_a_package_without_pilots_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    with pytest.raises(UserError, match="this package holds no pilots") as error:
        shipped.paths("all")
    assert error.value.exit_code == EXIT_DATA


def test_the_command_lists_them(folder, capsys):
    assert commands.main(["pilots"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 7 and lines[1].split()[:2] == ["ippo-attacker-9", "6.0"]
    assert "hover_guard (0.10)" in lines[2] and "nobody" in lines[1]
    assert "make train-ippo, make train-sippo" in lines[-1]


def test_the_package_holds_ten_policies_a_side_of_each_method_each_with_its_card():
    known, cards = shipped.names(), shipped.cards()
    assert set(cards) == set(known) and len(known) == 86
    study = "experiments/variants.py experiments/studies/strength.toml --only"
    methods = {
        "ippo": ("make train-ippo", 20_400_000),
        "sippo": ("make train-sippo", 20_400_000),
        "strong": (f"{study} strong-untaught", 40_200_000),
        "league": (f"{study} league-last", 40_200_000),
    }
    for kind in (f"{method}-{side}" for method in methods for side in SIDES):
        chunks = [int(name.rpartition("-")[2]) for name in known if name.startswith(f"{kind}-")]
        assert len(chunks) == 10 and chunks == sorted(chunks) and chunks[0] > 0
    responders = "dronecombat exploit PILOT --preset responder --budget 40e6"
    assert [name for name in known if name.startswith("responder")] == [
        f"responder-attacker-{number}" for number in range(1, 7)
    ]
    methods["responder"] = (responders, 40_200_000)
    for name, card in cards.items():
        command, steps = methods[name.partition("-")[0]]
        assert card.low < card.rating < card.high and card.trained == command
        assert 0 < card.steps <= steps


def test_every_shipped_pilot_flies_in_the_default_game():
    """Whole, of the game of preset `duel`, whatever each sees, with weights that are numbers."""
    found = find("pilots:all")
    config = settings.load("duel")
    game = environment(config)
    assert len(found.contenders) == 86 and found.bad == ()
    for contender in found.contenders:
        assert contender.environment is not None
        assert game_diff(contender.environment, game, config.game) == []
        assert contender.player is not None and not isinstance(contender.player.pilot, str)
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(contender.player.pilot))
