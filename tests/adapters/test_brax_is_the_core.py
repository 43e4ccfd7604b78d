"""The brax view over a thousand fights of real physics: each step is the core's, with crashes,
time-outs and fresh starts.
"""

import jax
import numpy as np
import pytest
from side_views import Core, Count, close

from dronecombat_jax.adapters.brax_env import CombatEnv, wrap
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.scripted import build_pilot
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause

SIZE, STEPS, HOVER = 1000, 90, 0.0526


@pytest.mark.slow
@pytest.mark.parametrize("role", [DEFENDER, ATTACKER])
def test_each_step_of_1000_fights_is_the_cores(role: int):
    combat = Combat(Config(game=GameConfig(episode_steps=40, spawn="uniform")))
    pilot = build_pilot(("dash", "hover_guard")[role], combat.config, combat.scene)
    env = wrap(CombatEnv(combat, role, pilot), combat.config.game.episode_steps)
    core, step, count = Core(combat, role, pilot), jax.jit(env.step), Count()
    actions = np.random.default_rng(3).normal(scale=0.3, size=(STEPS, SIZE, 4)).astype(np.float32)
    actions[:, ::2] = [HOVER, 0.0, 0.0, 0.0]  # half of the fights last until time runs out
    state = jax.jit(env.reset)(jax.random.split(jax.random.key(5), SIZE))
    for action in actions:
        after, output = core.step(state.pipeline_state, action)
        state = step(state, action)
        final = np.asarray(output.observation[:, role])
        over = np.asarray(output.terminated | output.truncated)
        close(state.info["final_observation"], final)
        close(state.reward, output.reward[:, role])
        np.testing.assert_array_equal(state.done, over)
        np.testing.assert_array_equal(state.info["truncation"], output.truncated)
        close(state.obs[~over], final[~over])
        close(state.obs, core.observe(state.pipeline_state))
        np.testing.assert_array_equal(state.pipeline_state.clock, np.where(over, 0, after.clock))
        assert not np.any(np.asarray(state.pipeline_state.qvel)[over])
        count = count.add(output, np.ones(SIZE, bool))
    assert count.terminated > 500 and count.truncated > 100
    assert {Cause.INTERCEPT, Cause.TIMEOUT, (Cause.DEFENDER_CRASH, Cause.ATTACKER_CRASH)[role]} <= (
        count.causes
    )
