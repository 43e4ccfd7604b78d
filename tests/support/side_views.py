"""What a view of one side must show, by the core alone: the core's step from the state before it."""

from typing import NamedTuple

import jax
import numpy as np

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.scripted import Pilot
from dronecombat_jax.types import EnvState, StepOutput


class Core:
    """The core's own step for a batch of fights, the opponent flown as in the arena: as one batch.

    For pilots that draw nothing; their key is none of the view's.
    """

    def __init__(self, combat: Combat, role: int, pilot: Pilot | None, options: dict | None = None):
        self.combat, self.role = combat, role

        def step(fight: EnvState, action: jax.Array) -> tuple[EnvState, StepOutput]:
            seen = jax.vmap(combat.observe)(fight)
            other = action * 0.0 if pilot is None else pilot(fight, seen, jax.random.key(0))
            pair = [other, action] if role == 1 else [action, other]
            return jax.vmap(combat.step)(fight, jax.numpy.stack(pair, axis=1))

        self.step = jax.jit(step, compiler_options=options)
        self.observe = jax.jit(
            lambda fight: jax.vmap(combat.observe)(fight)[:, role], compiler_options=options
        )


class Count(NamedTuple):
    """How many fights ended, and how."""

    terminated: int = 0
    truncated: int = 0
    causes: frozenset = frozenset()

    def add(self, output: StepOutput, of: np.ndarray) -> "Count":
        ended = np.asarray(output.cause)[of & (np.asarray(output.cause) > 0)]
        return Count(
            self.terminated + int(np.sum(np.asarray(output.terminated) & of)),
            self.truncated + int(np.sum(np.asarray(output.truncated) & of)),
            self.causes | set(ended.tolist()),
        )


def close(seen, expected) -> None:
    np.testing.assert_allclose(seen, expected, rtol=1e-5, atol=1e-5)


def compare(env, core: Core, actions: np.ndarray) -> Count:
    """Fly a Gymnasium vector environment with `actions` [T, N, 4] and compare each step with the
    core's.
    """
    mode, count = env.autoreset_mode.name, Count()
    observation, _ = env.reset(seed=5)
    close(observation, core.observe(env.bout.fight))
    over = np.zeros(env.num_envs, bool)
    for action in actions:
        before = env.bout.fight
        after, output = core.step(before, action)
        observation, reward, terminated, truncated, infos = env.step(action)
        flown = ~over if mode == "NEXT_STEP" else np.ones_like(over)
        close(reward, np.where(flown, output.reward[:, core.role], 0.0))
        np.testing.assert_array_equal(terminated, output.terminated & flown)
        np.testing.assert_array_equal(truncated, output.truncated & flown)
        ended = terminated | truncated
        final = np.asarray(output.observation[:, core.role])
        begun = ended if mode == "SAME_STEP" else ~flown
        close(observation[~begun], final[~begun])
        # A fight that has newly begun is one of the core's starts: nobody has moved, no time passed.
        fight = env.bout.fight
        close(observation, core.observe(fight))
        np.testing.assert_array_equal(fight.clock, np.where(begun, 0, after.clock))
        assert not np.any(np.asarray(fight.qvel)[begun])
        close(np.asarray(fight.qpos)[~begun], np.asarray(after.qpos)[~begun])
        told = infos.get("final_info", {}) if mode == "SAME_STEP" else infos
        if ended.any():
            np.testing.assert_array_equal(told["cause"][ended], output.cause[ended])
            np.testing.assert_array_equal(told["_cause"], ended)
        if mode == "SAME_STEP" and ended.any():
            np.testing.assert_array_equal(infos["_final_obs"], ended)
            close(np.stack(infos["final_obs"][ended]), final[ended])
        over, count = ended, count.add(output, flown)
    return count
