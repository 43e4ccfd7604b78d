"""`dronecombat export` of a side whose drones learnt a policy each: all in one file, or one alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from saved_runs import TOY, write_run
from toy import assert_same_bits

from dronecombat_jax.arena.players import refuse_other_shape
from dronecombat_jax.cli import commands as cli
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.files import tensorfile
from dronecombat_jax.policies.file import load_policy
from dronecombat_jax.policies.numpy_policy import NumpyPolicy
from dronecombat_jax.runs.evaluation import load_run, policies
from dronecombat_jax.tournaments.contenders import find
from dronecombat_jax.types import DEFENDER, Policy, TeamPolicy

GAME = replace(TOY.game, defenders=2)
OWN = replace(TOY, game=GAME, learn=replace(TOY.learn, mates="own"))


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    return write_run(tmp_path_factory.mktemp("runs") / "own", OWN, chunks=1)


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def export(run: Path, *args: str) -> int:
    return cli.main(["export", str(run), *args])


def one_error(capsys) -> str:
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("error: ") and len(err.splitlines()) == 1
    return err.removeprefix("error: ").strip()


def test_a_file_holds_the_policies_of_all_mates(run: Path, capsys):
    assert export(run, "both.safetensors", "--role", "defender") == 0
    line = "both.safetensors: 2 defenders with a policy each of own, seed 4, chunk 1"
    assert capsys.readouterr().out.startswith(line)
    policy, info = load_policy(Path("both.safetensors"))
    wanted = policies(load_run(run), 0)[DEFENDER]
    assert isinstance(policy, TeamPolicy) and len(policy.mates) == info.mates == 2
    assert_same_bits(policy, wanted)
    arrays, metadata = tensorfile.read(Path("both.safetensors"))
    assert arrays["weights.0"].shape == (2, 51, 8) and arrays["observation_count"].shape == (2,)
    assert (metadata["format_version"], metadata["mates"]) == ("3", "2")
    of_file = find("both.safetensors").contenders[0].entrant.identity
    assert of_file == find(str(run)).contenders[0].entrant.identity


def test_one_drones_policy_is_a_plain_file(run: Path, capsys):
    assert export(run, "second.safetensors", "--role", "defender", "--drone", "2") == 0
    assert capsys.readouterr().out.startswith("second.safetensors: defender 2 alone of own, seed 4")
    policy, info = load_policy(Path("second.safetensors"))
    both = policies(load_run(run), 0)[DEFENDER]
    assert isinstance(policy, Policy) and isinstance(both, TeamPolicy)
    assert (info.mates, info.drone) == (1, 2)
    assert_same_bits(policy, both.mates[1])
    seen = np.zeros(51, np.float32)
    flown = NumpyPolicy("second.safetensors")(seen)
    export(run, "first.safetensors", "--role", "defender", "--drone", "1")
    assert not np.allclose(flown, NumpyPolicy("first.safetensors")(seen))
    assert export(run, "second.h", "--role", "defender", "--drone", "2") == 0
    assert " * drone: 2" in Path("second.h").read_text()
    assert export(run, "attacker.h", "--role", "attacker") == 0  # there is one


def test_what_has_room_for_one_policy_says_how_to_get_one(run: Path, here: Path, capsys):
    assert export(run, "policy.h", "--role", "defender") == EXIT_CONFIG
    assert one_error(capsys) == (
        "policy.h has room for one policy, and each of 2 team mates has its own: "
        "dronecombat export RUN --drone 2 FILE takes that of the second"
    )
    assert export(run, "a.h", "--role", "defender", "--drone", "3") == EXIT_CONFIG
    assert one_error(capsys) == "--drone 3: own has defenders 1 to 2"
    assert export(run, "a.h", "--role", "attacker", "--drone", "1") == EXIT_CONFIG
    words = "--drone 1: every attacker of own flies one policy: leave it out"
    assert one_error(capsys) == words
    assert list(here.iterdir()) == []
    assert export(run, "both.safetensors", "--role", "defender") == 0
    with pytest.raises(ValueError, match=r"holds the policies of 2 drones; dronecombat export RUN"):
        NumpyPolicy("both.safetensors")


def test_an_onnx_file_has_room_for_one_policy(run: Path, here: Path, capsys):
    pytest.importorskip("onnx", reason="onnx is not installed: pip install onnx")
    assert export(run, "policy.onnx", "--role", "defender") == EXIT_CONFIG
    assert one_error(capsys).startswith("policy.onnx has room for one policy")
    assert list(here.iterdir()) == []
    assert export(run, "policy.onnx", "--role", "defender", "--drone", "1") == 0


@pytest.mark.parametrize("defenders", [1, 3])
def test_such_a_team_flies_in_teams_of_its_size_alone(run: Path, defenders: int):
    """Also where games may differ, as with `nearest`, which is as long in every team."""
    team = policies(load_run(run), 0)[DEFENDER]
    other = replace(OWN, game=replace(GAME, defenders=defenders))
    words = f"^mine is 2 defenders with a policy each, and this game has {defenders}: it cannot"
    with pytest.raises(UserError, match=words):
        refuse_other_shape("mine", DEFENDER, team, other)
    refuse_other_shape("mine", DEFENDER, team, OWN)
