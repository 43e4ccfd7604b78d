"""Policies of teams as files: what they see depends on the sizes of both teams."""

from dataclasses import replace
from pathlib import Path

import pytest
from policies import make_info, make_policy

from dronecombat_jax.combat.observe import observation_of
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.policies.c_header import header_of
from dronecombat_jax.policies.file import load_policy, require_environment, save_policy
from dronecombat_jax.policies.numpy_policy import NumpyPolicy

GAME = GameConfig(defenders=2, attackers=3)


@pytest.mark.parametrize(
    ("observation", "size"), [("world", 83), ("ego", 83), ("bearing", 35), ("nearest", 59)]
)
def test_a_policy_of_a_team_comes_back(tmp_path: Path, observation: str, size: int):
    """16 numbers a drone and 3 of the target; 19 own ones and 4 for each other; 19 and 4 slots."""
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
