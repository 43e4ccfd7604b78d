"""The vector view for Stable-Baselines3: what its learners read of every end, and that one learns."""

import numpy as np
import pytest
from brax_views import LENGTH, hold
from toy import Coasting

from dronecombat_jax.adapters.gymnasium_env import CombatVectorEnv
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.types import ATTACKER

pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.vec_env import (  # pyright: ignore[reportMissingImports]
    VecMonitor,
    VecNormalize,
)

from dronecombat_jax.adapters.sb3_env import to_sb3

SIZE = 6


def fights(mode: str = "SAME_STEP") -> CombatVectorEnv:
    combat = Coasting(Config(game=GameConfig(episode_steps=LENGTH)))
    return CombatVectorEnv(combat, ATTACKER, hold, SIZE, mode)


def test_every_end_is_told_as_stable_baselines3_reads_it():
    twin, env = fights(), to_sb3(fights())
    env.seed(3)
    np.testing.assert_array_equal(env.reset(), twin.reset(seed=3)[0])
    random, ended = np.random.default_rng(0), [0, 0]
    for _ in range(2 * LENGTH):
        action = random.normal(scale=0.5, size=(SIZE, 4)).astype(np.float32)
        action[::2] = [0.5, 0, 0, 0]
        observation, reward, dones, infos = env.step(action)
        expected = twin.step(action)
        np.testing.assert_array_equal(observation, expected[0])
        np.testing.assert_array_equal(reward, expected[1])
        np.testing.assert_array_equal(dones, expected[2] | expected[3])
        for index, info in enumerate(infos):
            if not dones[index]:
                assert info == {}
                continue
            final = expected[4]["final_obs"][index]
            np.testing.assert_array_equal(info["terminal_observation"], final)
            assert info["TimeLimit.truncated"] is bool(expected[3][index])
            assert info["cause"] == expected[4]["final_info"]["cause"][index]
            assert info["is_success"] is (info["outcome"] == 1)
            ended[info["TimeLimit.truncated"]] += 1
    assert min(ended) > 0
    assert env.get_attr("time_limit", [0, 1]) == [LENGTH] * 2


def test_a_view_that_begins_anew_a_step_later_is_refused():
    with pytest.raises(UserError, match="NEXT_STEP: Stable-Baselines3 needs SAME_STEP"):
        to_sb3(fights("NEXT_STEP"))


def test_its_wrappers_and_ppo_take_it():
    env = VecNormalize(VecMonitor(to_sb3(fights())))
    model = PPO("MlpPolicy", env, n_steps=LENGTH, batch_size=32, n_epochs=1, seed=0, device="cpu")
    model.learn(2 * LENGTH * SIZE)
    assert len(model.ep_info_buffer) >= SIZE
    assert all(0 < info["l"] <= LENGTH for info in model.ep_info_buffer)
