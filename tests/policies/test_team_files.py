"""Policies of teams as files: what they see depends on the sizes of both teams."""

from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest
from policies import make_info, make_policy
from policy_files import write

from dronecombat_jax.combat.observe import observation_of
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.files.tensorfile import PolicyError
from dronecombat_jax.policies.c_header import header_of
from dronecombat_jax.policies.file import load_policy, require_environment, save_policy
from dronecombat_jax.policies.numpy_policy import NumpyPolicy
from dronecombat_jax.types import TeamPolicy

GAME = GameConfig(defenders=2, attackers=3)


@pytest.mark.parametrize(
    ("observation", "size"),
    [
        ("world", 83),
        ("ego", 83),
        ("engagement", 147),
        ("tracks", 107),
        ("bearing", 35),
        ("nearest", 59),
    ],
)
def test_a_policy_of_a_team_comes_back(tmp_path: Path, observation: str, size: int):
    """16 numbers a drone and 3 of the target; with 13 more for each other
    and 12 for the target; of these without 10 for each other; 19 own ones and 4 for each other; 19
    and 4 slots.
    """
    config = Config(game=replace(GAME, observation=observation))  # pyright: ignore[reportArgumentType]
    assert observation_of(config).size == size
    info = make_info(config, layer_sizes=(size, 8, 4))
    path = tmp_path / "team.safetensors"
    save_policy(path, make_policy((size, 8, 4)), info)
    assert load_policy(path).info == info and require_environment(info, config) == []
    assert NumpyPolicy(path).mean.shape == (size,)


def test_a_header_says_that_a_team_does_not_see_eq_5():
    """`bearing` of 2 against 3 has 35 numbers, and `world` another number than 35."""
    for config, size, world in (
        (Config(), 35, 1),
        (Config(game=GAME), 83, 0),
        (Config(game=replace(GAME, observation="bearing")), 35, 0),
    ):
        text = header_of(make_policy((size, 8, 4)), make_info(config, layer_sizes=(size, 8, 4)))
        assert f"#define DRONECOMBAT_WORLD {world} " in text


@pytest.mark.parametrize("memory", ["none", "frames 2"])
def test_the_policies_of_all_mates_come_back_and_their_number_is_proven(
    tmp_path: Path, memory: str
):
    size, frames = 83, 2 if memory != "none" else 1
    team = TeamPolicy(tuple(make_policy((frames * size, 8, 4), seed, frames) for seed in (0, 1)))
    sizes = (size, 8, 4)
    info = make_info(Config(game=GAME), role="defender", layer_sizes=sizes, memory=memory, mates=2)
    path = tmp_path / "team.safetensors"
    save_policy(path, team, info)
    loaded = load_policy(path)
    assert loaded.info == info and isinstance(loaded.policy, TeamPolicy)
    for ours, theirs in zip(*map(jax.tree.leaves, (loaded.policy, team)), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    with pytest.raises(PolicyError, match=r"not written: its arrays are not those of layer_sizes"):
        save_policy(tmp_path / "one.safetensors", team.mates[0], info)
    with pytest.raises(PolicyError, match="not written: its arrays are not those"):
        save_policy(tmp_path / "more.safetensors", TeamPolicy(team.mates * 2), info)


@pytest.mark.parametrize(
    ("metadata", "words"),
    [
        ({"format_version": "3"}, "metadata mates is missing"),
        (
            {"format_version": "3", "mates": "2"},
            "metadata mates is 2: expected 1 to 1, by the size",
        ),
        ({"format_version": "3", "mates": "1"}, "metadata format_version is 3: expected 1"),
        ({"drone": "2"}, "metadata drone is 2: expected 1 to 1, by the size of its team"),
    ],
)
def test_a_file_of_a_duel_holds_no_team(tmp_path: Path, metadata: dict[str, str], words: str):
    with pytest.raises(PolicyError) as refused:
        load_policy(write(tmp_path / "policy.safetensors", metadata=metadata))
    assert words in refused.value.message and "\n" not in refused.value.message
