"""Rules across settings: each broken one is one line."""

import pytest
from hypothesis import HealthCheck
from hypothesis import given as over
from hypothesis import settings as limits
from hypothesis import strategies as st
from refusals import errors_of

from dronecombat_jax.config import preflight, settings
from dronecombat_jax.errors import UserError

# Other work may share the machine: nothing here is about time.
UNHURRIED = limits(deadline=None, suppress_health_check=[HealthCheck.too_slow], database=None)


@pytest.mark.parametrize(
    ("overrides", "opening", "message"),
    [
        # 60 * 24 = 1440 = 7 * 205 + 5; 7 and 24 share no factor, so environments come in sevens:
        # 56, 63.
        ({"train.num_envs": 60, "learn.minibatches": 7}, "--learn.minibatches: ", "minibatches 6 or 8, train.num_envs 56 or 63"),
        # 1001 * 24 = 24024 = 2^3 * 3 * 7 * 11 * 13: the neighbours of 9 are 8 and 11; 9 = 3 * gcd 3
        # wants threes.
        ({"train.num_envs": 1001, "learn.minibatches": 9}, "--learn.minibatches: ", "minibatches 8 or 11, train.num_envs 999 or 1002"),
        ({"train.num_envs": 1, "learn.minibatches": 100_000}, "--learn.minibatches: ", "minibatches 24, train.num_envs 12500"),
        ({"train.num_envs": 1, "learn.rollout_steps": 7}, "--train.num-envs: ", "minibatches 1 or 7, train.num_envs 6"),
        ({"learn.rollout_steps": 7}, "--learn.rollout-steps: ", "minibatches 5 or 7, train.num_envs 996 or 1002"),
        ({"game.spawn_altitude_low": 2.0}, "--game.spawn-altitude-low: ", "must not exceed"),
        ({"game.crash_altitude": 0.5}, "--game.crash-altitude: ", "must be below game.spawn_altitude_low = 0.5"),
        ({"game.spawn": "uniform", "game.spawn_spread": 1.0}, "--game.spawn: ", "spawn_spread = 1 is of fixed starts"),
        ({"game.spawn": "uniform", "game.defender_spread": 2.0}, "--game.spawn: ", "defender_spread = 2 is of fixed starts"),
        ({"game.scenario": "solo", "train.solo_share": 0.2}, "--train.solo-share: ", 'needs game.scenario = "duel"'),
        # 8 environments, one of them for the attacker alone: 7 * 24 = 168 steps
        ({"train.num_envs": 8, "learn.minibatches": 64, "train.solo_share": 0.1}, "--train.solo-share: ", "7 environments and 168 steps"),
        ({"train.num_envs": 1, "train.solo_share": 0.6}, "--train.solo-share: ", "0 environments and 0 steps"),
        ({"sim.body": "p250", "sim.mjcf": "x2.xml"}, "--sim.body: ", "with sim.mjcf both come out of the file"),
        ({"sim.battery": 3.7}, "--sim.battery: ", "must be rotors, mixed or ctbr"),
        ({"sim.battery": 3.7, "sim.body": "racer", "sim.actuation": "ctbr"}, "--sim.battery: ", "no battery is known"),
        ({"sensor.bias": 1.0}, "--sensor.bias: ", "sensor.bias = 1 is a multiple of the noise"),
        ({"sim.gust_speed": 1.0}, "--sim.gust-speed: ", "pushes by drag: sim.drag must be true"),
        ({"randomise.lag": 0.2}, "--randomise.lag: ", "needs sim.actuation other than wrench"),
        ({"defender.lag": 2.0}, "--defender.lag: ", "needs sim.actuation other than wrench"),
        ({"attacker.drag": 0.5}, "--attacker.drag: ", "attacker.drag = 0.5 needs sim.drag"),
        ({"randomise.drag": 0.2}, "--randomise.drag: ", "needs sim.drag"),
        ({"randomise.battery": 0.2}, "--randomise.battery: ", "needs sim.battery"),
        ({"learn.others": "mean"}, "--learn.others: ", "needs game.observation = nearest"),
        ({"learn.min_learning_rate": 0.1}, "--learn.min-learning-rate: ", "0.1, 0.0003, 0.01"),
        ({"learn.learning_rate": 0.1}, "--learn.learning-rate: ", "must hold"),
        ({"learn.min_log_std": 1.0}, "--learn.min-log-std: ", "must hold, but they are 1, 0, 2"),
        ({"learn.initial_log_std": 1.0, "learn.max_log_std": 0.5}, "--learn.initial-log-std: ", "must hold"),
        ({"learn.critic": "central", "learn.algorithm": "mine:MINE"}, "--learn.critic: ", "needs learn.algorithm = ppo"),
        ({"learn.memory": "frames", "learn.others": "mean", "game.observation": "nearest"}, "--learn.memory: ", "needs learn.others = flat"),
        ({"learn.memory": "gru"}, "--learn.memory: ", "learn.minibatches = 6 must divide those that a side learns from, 1000"),
        ({"learn.memory": "frames", "learn.algorithm": "mine:MINE"}, "--learn.memory: ", "needs learn.algorithm = ppo"),
        ({"learn.others": "mean", "game.observation": "nearest", "learn.algorithm": "mine:MINE"}, "--learn.others: ", "needs learn.algorithm = ppo"),
        ({"run.name": ".hidden"}, "--run.name: ", "not start with a dot"),
        ({"run.name": "../up"}, "--run.name: ", "A-Z a-z"),
        ({"run.name": "a" * 101}, "--run.name: ", "at most 100"),
        ({"run.directory": ""}, "--run.directory: ", "must not be empty"),
        ({"train.seed": 2**31 - 1, "train.num_seeds": 2}, "--train.seed: ", "at most 2147483647"),
        # 10^12 steps of 24 * 6 are 6.9 * 10^9 iterations
        ({"train.total_steps": 10**12, "train.num_envs": 6}, "--train.total-steps: ", "at most 2147483647"),
        ({"train.num_envs": 10**6, "train.num_seeds": 1024}, "--train.num-envs: ", "of memory, and this machine has 8 GiB"),
        ({"learn.hidden_sizes": (8192,) * 16}, "--learn.hidden-sizes: ", "GiB of memory"),
    ],
)  # fmt: skip
def test_rules_across_settings(monkeypatch, overrides, opening, message):
    monkeypatch.setattr(preflight, "machine_bytes", lambda: 8 * 2**30)
    monkeypatch.setattr(preflight, "free_bytes", lambda path: None)
    (line,) = errors_of(None, overrides, check_machine=True)
    assert line.startswith(opening) and message in line


def test_broken_rules_are_all_told_and_placed_in_the_file(toml):
    path = toml("[game]\nspawn_altitude_low = 3.0\n\n[learn]\nminibatches = 7\n")
    first, second = errors_of(path)
    assert first.startswith(f"{path}:2: ") and second.startswith(f"{path}:5: ")


def test_a_constant_learning_rate_is_not_held_between_the_bounds_of_the_schedule():
    settings.load(None, {"learn.learning_rate": 0.1, "learn.learning_rate_schedule": "constant"})


@UNHURRIED
@over(envs=st.integers(1, 3000), steps=st.integers(1, 200), parts=st.integers(1, 3000))
def test_the_nearest_values_named_do_fit(envs, steps, parts):
    given = {"train.num_envs": envs, "learn.rollout_steps": steps, "learn.minibatches": parts}
    if envs * steps % parts == 0:
        settings.load(None, given)
        return
    (line,) = errors_of(None, given)
    named = line.split("nearest that fit: ")[1]
    for key, words in (part.strip().split(" ", 1) for part in named.split(",")):
        for word in words.split(" or "):
            settings.load(None, {**given, key: int(word)})


def test_self_play_needs_two_sides():
    with pytest.raises(UserError) as error:
        settings.load("solo", {"selfplay.probability": 0.2})
    assert error.value.message.startswith(
        "--selfplay.probability: selfplay.probability = 0.2 needs game.scenario"
    )


@pytest.mark.parametrize(
    "text", ["", "none", "every", "every 0", "last -1", "every 2 ", "EVERY 3", "last 1.5"]
)
def test_which_checkpoints_stay_has_three_forms(text):
    with pytest.raises(UserError, match=r'run\.keep = .* must be "all", "every N" or "last N"'):
        settings.load("smoke", {"run.keep": text})
