"""A critic that sees the whole state: what it sees, what it can credit, and that a policy does not
see it.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from probes import STEPS, Probe, paid_at_last

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.fields import Config, GameConfig, LearnConfig, SensorConfig, TrainConfig
from dronecombat_jax.learn.ippo import init_learner
from dronecombat_jax.types import EnvState

BEST = (0.5, -0.5)


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


class Delayed(Probe):
    """The first action is kept where no policy sees it, and paid for in the last step,
    -(kept - best)^2.

    What a policy sees, the steps flown, is the same whatever was done; so is the value of it, and
    the first action is credited with nothing unless the critic sees what was kept.
    """

    def first(self, numbers: jax.Array) -> jax.Array:
        return jnp.zeros_like(numbers)

    def observe(self, state: EnvState) -> jax.Array:
        return jnp.zeros((2, 35)).at[:, 0].set(state.clock)

    def observe_whole(self, state: EnvState) -> jax.Array:
        shared = jnp.broadcast_to(state.qpos, (2, 2))
        return jnp.concatenate([self.observe(state)[:, :33], shared, jnp.eye(2)], axis=1)

    def paid(self, state: EnvState, action: jax.Array) -> tuple[jax.Array, jax.Array]:
        kept = jnp.where(state.clock == 0, action, state.qpos)
        return kept, -((kept - jnp.asarray(BEST)) ** 2)


def paid(critic: str) -> np.ndarray:
    probe, size = Delayed(config_of(critic)), 37 if critic == "central" else None
    init = lambda key: init_learner(key, probe.config.learn, critic_size=size)
    return paid_at_last(probe, jax.vmap(init)(jax.random.split(jax.random.key(1))))


@pytest.mark.slow
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
