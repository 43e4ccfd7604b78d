"""A probe environment: a stand-in for `Combat` whose optimal values and actions are known in closed
form.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import pytest

from dronecombat_jax.config.fields import Config
from dronecombat_jax.types import Cause, EnvState, RewardTerms, StepOutput


class Task(NamedTuple):
    """What a probe pays at every step, per agent [A]; data, so that one program serves every task.

    A fight shows x = +1 or -1 in all its `length` steps. The reward is
    constant + sign x + last [last step] - effort (a0 - centre - slope x)^2.
    """

    constant: jax.Array
    sign: jax.Array
    last: jax.Array
    effort: jax.Array
    centre: jax.Array
    slope: jax.Array
    length: jax.Array  # [] steps of a fight
    flies: jax.Array  # [] steps of it in which the drones fly; then they lie there
    truncates: jax.Array  # [] bool, a fight ends by time-out instead of a decision


class Probe:
    """The methods of `Combat` that learning calls.

    Observation: x, steps flown (unless it truncates), zeros.
    """

    def __init__(self, config: Config, task: Task):
        self.config, self.task = config, task

    def start_numbers(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        return jax.random.uniform(key, (*shape, 1))

    def spawn(self, numbers: jax.Array) -> EnvState:
        x = jnp.where(numbers < 0.5, -1.0, 1.0)
        return EnvState(
            qpos=x,
            qvel=jnp.zeros(1),
            target=jnp.zeros(3),
            clock=jnp.zeros((), jnp.int32),
            down=jnp.zeros(2, bool),
        )

    exploring_numbers = start_numbers

    def explore(self, numbers: jax.Array, alone: jax.Array) -> EnvState:
        state = self.spawn(numbers)
        return state.replace(down=state.down.at[0].set(alone))

    def observe(self, state: EnvState) -> jax.Array:
        # else a final observation was never trained on
        clock = jnp.where(self.task.truncates, 0, state.clock)
        row = jnp.concatenate([state.qpos, clock.astype(jnp.float32)[None], jnp.zeros(33)])
        return jnp.broadcast_to(row, (2, 35))

    def step(self, state: EnvState, action: jax.Array) -> tuple[EnvState, StepOutput]:
        task, x = self.task, state.qpos[0]
        after = state.replace(clock=state.clock + 1)
        done = after.clock >= task.length
        error = action[:, 0] - task.centre - task.slope * x
        reward = task.constant + task.sign * x + task.last * done - task.effort * error**2
        zero = jnp.zeros(2)
        output = StepOutput(
            observation=self.observe(after),
            reward=reward,
            reward_terms=RewardTerms(reward, *[zero] * 6),
            cause=jnp.where(
                done, jnp.where(task.truncates, Cause.TIMEOUT, Cause.REACHED), Cause.NONE
            ).astype(jnp.int32),
            terminated=done & ~task.truncates,
            truncated=done & task.truncates,
            active=jnp.broadcast_to(state.clock < task.flies, 2),
            idle=jnp.broadcast_to(state.clock >= task.flies, 2),
        )
        return after, output


@pytest.fixture(scope="session")
def make_task() -> Callable[..., Task]:
    """A task from the terms that it pays; each one number, or one per agent."""

    def make(length: int = 1, flies: int = 10**6, truncates: bool = False, **terms) -> Task:
        given = {
            name: jnp.broadcast_to(jnp.asarray(value, jnp.float32), 2)
            for name, value in terms.items()
        }
        zeros = {name: jnp.zeros(2) for name in Task._fields[:6]}
        steps = {"length": jnp.int32(length), "flies": jnp.int32(flies)}
        return Task(**zeros | given, **steps, truncates=jnp.asarray(truncates))

    return make


@pytest.fixture(scope="session")
def make_probe() -> type[Probe]:
    return Probe
