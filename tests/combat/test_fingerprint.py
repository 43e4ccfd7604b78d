"""The digest changes with what a policy meets and with nothing else."""

import dataclasses
import json

import pytest

from dronecombat_jax import settings
from dronecombat_jax.combat import fingerprint
from dronecombat_jax.combat.fingerprint import environment, environment_diff, environment_digest, observation_fields
from dronecombat_jax.config import Config, GameConfig, LearnConfig, RewardConfig, SimConfig, TrainConfig

GAME_SETTINGS = [key for key in settings.SCHEMA if key.startswith(("sim.", "game.")) and key != "game.random_clock"]


def other_value(key: str):
    entry = settings.SCHEMA[key]
    if entry.kind == "bool":
        return not entry.default
    if entry.kind == "choice":
        return next(choice for choice in entry.choices if choice != entry.default)
    return entry.high if entry.kind == "int" else (entry.default + entry.high) / 2


@pytest.mark.parametrize("key", GAME_SETTINGS)
def test_every_setting_of_the_game_changes_the_digest(key):
    section, name = key.split(".")
    part = dataclasses.replace(getattr(Config(), section), **{name: other_value(key)})
    config = dataclasses.replace(Config(), **{section: part})
    assert environment_digest(config) != environment_digest(Config())
    changed = environment_diff(environment(config), environment(Config()))
    assert [line.split(" is ")[0] for line in changed if not line.startswith("observation_fields")] == [key]


def test_nothing_else_changes_it():
    same = Config(
        sim=SimConfig(moment_scale=0.01, max_body_rate=100),  # 100 for 100.0
        game=GameConfig(random_clock=False),
        reward=RewardConfig(win=1.0),
        learn=LearnConfig(hidden_sizes=(8,)),
        train=TrainConfig(seed=4),
    )
    assert environment_digest(same) == environment_digest(Config())
    assert environment_diff(environment(same), environment(Config())) == []


def test_a_new_version_of_the_game_changes_it(monkeypatch):
    before = environment_digest(Config())
    monkeypatch.setattr(fingerprint, "ENVIRONMENT_VERSION", 2)
    assert environment_digest(Config()) != before


def test_a_setting_that_came_later_leaves_the_game_before_it_alone():
    assert environment_digest(Config()) == environment_digest(
        Config(game=GameConfig(spawn_spread=0, defender_spread=0))
    )
    assert {"game.spawn_spread", "game.defender_spread"}.isdisjoint(
        environment(Config())
    )  # checkpoints and policies from before it go on flying
    assert environment(Config(game=GameConfig(spawn_spread=1)))["game.spawn_spread"] == 1.0


def test_what_is_missing_on_one_side_is_a_difference():
    lines = environment_diff({"version": 1, "game.wind": 2.0}, {"version": 1, "game.spawn": "fixed"})
    assert lines == ['game.spawn is nothing there, "fixed" here', "game.wind is 2.0 there, nothing here"]


def test_fields_of_both_observations():
    world, ego = observation_fields("world"), observation_fields("ego")
    assert sum(size for _, size in world) == sum(size for _, size in ego) == 35
    assert [name for name, _ in world][:5] == ["p_d", "q_d", "p_a", "q_a", "p_t"]
    assert [name for name, _ in ego][:7] == ["p_self", "q_self", "p_other", "q_other", "p_t", "v_self", "w_self"]
    assert json.loads(json.dumps(environment(Config()))) == environment(Config())
