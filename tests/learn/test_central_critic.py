"""A critic that sees the whole state: what it sees, what it can credit, and that a policy does not
see it.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.fields import Config, GameConfig, LearnConfig, SensorConfig, TrainConfig
from dronecombat_jax.learn.algorithms import learn_from
from dronecombat_jax.learn.ippo import init_learner
from dronecombat_jax.learn.rollout import collect, policy_of, select
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause, EnvState, RewardTerms, StepOutput

STEPS, BEST = 3, (0.5, -0.5)
ITERATIONS = 60
QUICK_TO_COMPILE = {"xla_backend_optimization_level": 1, "xla_llvm_disable_expensive_passes": True}


def config_of(critic: str) -> Config:
    """One-step advantages: a step is credited with what its successor is worth, and with nothing
    later.
    """
    learn = LearnConfig(
        critic=critic,  # pyright: ignore[reportArgumentType]
        hidden_sizes=(16, 16),
        rollout_steps=2 * STEPS,
        epochs=4,
        minibatches=4,
        discount=0.9,
        gae_lambda=0.0,
        learning_rate=3e-3,
        entropy_scale=0.0,
    )
    return Config(learn=learn, train=TrainConfig(num_envs=64))


class Delayed:
    """Fights of three steps: the first action is kept where no policy sees it, and paid for in the
    last step, -(kept - best)^2.

    What a policy sees, the steps flown, is the same whatever was done; so is the value of it, and
    the first action is credited with nothing unless the critic sees what was kept.
    """

    def __init__(self, config: Config):
        self.config = config

    def exploring_numbers(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        return jnp.zeros((*shape, 1))

    def explore(self, numbers: jax.Array, alone: jax.Array) -> EnvState:
        return EnvState(
            qpos=jnp.zeros(2),
            qvel=jnp.zeros(1),
            target=jnp.zeros(3),
            clock=jnp.zeros((), jnp.int32),
            down=jnp.zeros(2, bool),
        )

    def observe(self, state: EnvState) -> jax.Array:
        return jnp.zeros((2, 35)).at[:, 0].set(state.clock)

    def observe_whole(self, state: EnvState) -> jax.Array:
        shared = jnp.broadcast_to(state.qpos, (2, 2))
        return jnp.concatenate([self.observe(state)[:, :33], shared, jnp.eye(2)], axis=1)

    def step(self, state: EnvState, action: jax.Array) -> tuple[EnvState, StepOutput]:
        kept = jnp.where(state.clock == 0, jnp.clip(action[:, 0], -2.0, 2.0), state.qpos)
        after = state.replace(qpos=kept, clock=state.clock + 1)
        done = after.clock == STEPS
        reward = -jnp.where(done, (kept - jnp.asarray(BEST)) ** 2, 0.0)
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


def paid(critic: str) -> np.ndarray:
    """What a fight pays at last, the mean of each agent [A] over the last ten iterations."""
    config = config_of(critic)
    probe = Delayed(config)
    size = 37 if critic == "central" else None
    learners = jax.vmap(lambda key: init_learner(key, config.learn, critic_size=size))(
        jax.random.split(jax.random.key(1))
    )

    @partial(jax.jit, compiler_options=QUICK_TO_COMPILE)
    def program(learners):
        env = jax.vmap(probe.explore, (0, None))(jnp.zeros((64, 1)), jnp.zeros((), bool))

        def one(carry, i):
            learners, env = carry
            noise, spawn, shuffle = jax.random.split(jax.random.fold_in(jax.random.key(0), i), 3)
            flying = policy_of(select(learners, DEFENDER)), policy_of(select(learners, ATTACKER))
            env, rollout = collect(probe, flying, env, noise, spawn)  # pyright: ignore
            both = jnp.ones(2, bool)
            learners, _ = learn_from(config.learn, learners, rollout, shuffle, both)
            return (learners, env), STEPS * jnp.mean(rollout.reward, axis=(0, 1))

        return jax.lax.scan(one, (learners, env), jnp.arange(ITERATIONS))[1]

    return np.mean(program(learners)[-10:], axis=0)


def test_an_action_that_only_the_whole_state_remembers_is_credited_by_a_central_critic_alone():
    # At the start the noise alone costs 1 and the distance of the mean from the best 0.25.
    own, central = paid("own"), paid("central")
    assert np.all(central > -0.2) and np.all(own < -0.7), (own, central)


@pytest.mark.parametrize("layout", ["world", "ego"])
def test_a_central_critic_sees_the_world_without_errors_and_who_it_is(layout: str):
    """Against eq. 5 as exact sensors give it; the policies see noise."""
    noise = SensorConfig(position_noise=0.1)
    seeing = Combat(Config(sensor=noise, game=GameConfig(observation=layout)))  # pyright: ignore
    fight = seeing.reset(jax.random.key(3))
    exact = Combat(Config()).reset(jax.random.key(3))
    fight = fight.replace(qpos=exact.qpos, qvel=exact.qvel, target=exact.target)
    whole = np.asarray(seeing.observe_whole(fight))
    assert np.array_equal(whole[:, :35], Combat(Config()).observe(exact))
    assert whole[:, 35:].tolist() == [[1.0, 0.0], [0.0, 1.0]]
    assert seeing.whole.size == whole.shape[1]
    assert not np.allclose(seeing.observe(fight), whole[:, :35])
