"""Fights of three steps that are not flown, and a learner on them: what it is paid shows what it can
credit, or remember.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from dronecombat_jax.config.fields import Config
from dronecombat_jax.learn.algorithms import learn_from
from dronecombat_jax.learn.memory import recall_size, with_recall
from dronecombat_jax.learn.rollout import collect, policy_of, select
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause, EnvState, RewardTerms, StepOutput

STEPS = 3  # of a fight
ITERATIONS = 60
QUICK_TO_COMPILE = {"xla_backend_optimization_level": 1, "xla_llvm_disable_expensive_passes": True}


class Probe:
    """The methods of `Combat` that learning calls. `qpos` [A] holds what a fight is about."""

    def __init__(self, config: Config):
        self.config = config

    def exploring_numbers(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        return jax.random.uniform(key, (*shape, 2))

    def explore(self, numbers: jax.Array, alone: jax.Array) -> EnvState:
        return EnvState(
            qpos=self.first(numbers),
            qvel=jnp.zeros(1),
            target=jnp.zeros(3),
            clock=jnp.zeros((), jnp.int32),
            down=jnp.zeros(2, bool),
        )

    def first(self, numbers: jax.Array) -> jax.Array:
        """What the fight is about at its start, [A], from uniform numbers [A]."""
        raise NotImplementedError

    def observe(self, state: EnvState) -> jax.Array:
        raise NotImplementedError

    def paid(self, state: EnvState, action: jax.Array) -> tuple[jax.Array, jax.Array]:
        """What the fight is about from now on, and the reward if this is its last step, both [A],
        after the first number of each action, [A].
        """
        raise NotImplementedError

    def step(self, state: EnvState, action: jax.Array) -> tuple[EnvState, StepOutput]:
        kept, reward = self.paid(state, jnp.clip(action[:, 0], -2.0, 2.0))
        after = state.replace(qpos=kept, clock=state.clock + 1)
        done = after.clock == STEPS
        reward = jnp.where(done, reward, 0.0)
        both = jnp.ones(2, bool)
        output = StepOutput(
            observation=self.observe(after),
            reward=reward,
            reward_terms=RewardTerms(reward, *[jnp.zeros(2)] * 6),
            cause=jnp.where(done, Cause.REACHED, Cause.NONE).astype(jnp.int32),
            terminated=done,
            truncated=jnp.zeros((), bool),
            active=both,
            idle=~both,
        )
        return after, output


def paid_at_last(probe: Any, learners: Any) -> np.ndarray:
    """What a fight pays, the mean of each agent [A] over the last ten iterations of learning."""
    config = probe.config
    envs = config.train.num_envs

    @partial(jax.jit, compiler_options=QUICK_TO_COMPILE)
    def program(learners):
        numbers = probe.exploring_numbers(jax.random.key(7), (envs,))
        env = jax.vmap(probe.explore, (0, None))(numbers, jnp.zeros((), bool))

        def one(carry, i):
            learners, env = carry
            noise, spawn, shuffle = jax.random.split(jax.random.fold_in(jax.random.key(0), i), 3)
            flying = policy_of(select(learners, DEFENDER)), policy_of(select(learners, ATTACKER))
            env, rollout = collect(probe, flying, env, noise, spawn)
            both = jnp.ones(2, bool)
            learners, _ = learn_from(config.learn, learners, rollout, shuffle, both)
            return (learners, env), STEPS * jnp.mean(rollout.reward, axis=(0, 1))

        start = learners, with_recall(env, recall_size(config))
        return jax.lax.scan(one, start, jnp.arange(ITERATIONS))[1]

    return np.mean(program(learners)[-10:], axis=0)
