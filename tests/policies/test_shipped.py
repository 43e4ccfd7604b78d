"""The pilots that come with the package: names, cards, size, and that they fly."""

import json

import numpy as np
import pytest

from dronecombat_jax.cli import commands
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA, UserError
from dronecombat_jax.policies import shipped
from dronecombat_jax.policies.file import load_policy
from dronecombat_jax.policies.numpy_policy import NumpyPolicy
from dronecombat_jax.tournaments.contenders import find

MOST_BYTES = 6_000_000  # of the wheel, which is compressed


def test_ten_of_each_side_and_method_with_a_card_each():
    names = shipped.names()
    kinds = {name.rpartition("-")[0] for name in names}
    assert kinds == {f"{m}-{side}" for m in ("ippo", "sippo") for side in ("defender", "attacker")}
    assert all(sum(name.rpartition("-")[0] == kind for name in names) == 10 for kind in kinds)
    cards = shipped.cards()
    assert cards.keys() == set(names)
    for name, card in cards.items():
        assert card.low < card.rating < card.high and card.steps > 0, name
        assert card.trained in ("make train-ippo", "make train-sippo")


@pytest.mark.parametrize("name", shipped.names())
def test_each_file_is_sound_and_says_who_it_is(name):
    (path,) = shipped.paths(name)
    _, info = load_policy(path)
    side, chunk = name.split("-")[1:]
    assert (info.role, info.chunk) == (side, int(chunk))
    assert shipped.cards()[name].steps == info.steps
    action = NumpyPolicy(path)(np.zeros(35))
    assert action.shape == (4,) and np.all(np.isfinite(action))


def test_the_newest_of_a_kind_needs_no_number():
    (path,) = shipped.paths("ippo-attacker")
    numbers = [int(name.rpartition("-")[2]) for name in shipped.names() if "ippo-att" in name]
    assert path.stem == f"ippo-attacker-{max(numbers)}"
    assert len(shipped.paths("all")) == len(shipped.names()) == 40


def test_all_of_them_take_part_in_a_tournament():
    found = find("pilots:all")
    assert len(found.contenders) == 40 and found.config is not None
    assert {contender.role for contender in found.contenders} == {0, 1}
    assert len({contender.entrant.identity for contender in found.contenders}) == 40


def test_an_unknown_name_is_one_line(capsys):
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


def test_the_command_lists_them(capsys):
    assert commands.main(["pilots"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 42 and "ippo-attacker" in lines[1] and "1500" in lines[-1]


def test_they_are_small_enough_to_ship():
    import zlib

    packed = sum(len(zlib.compress(path.read_bytes())) for path in shipped.paths("all"))
    assert packed < MOST_BYTES - 1_000_000  # the rest of the wheel
    assert json.loads((shipped.FOLDER / shipped.CARDS).read_text())
