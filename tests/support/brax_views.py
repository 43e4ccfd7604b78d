"""Fights through the view for brax."""

import jax
import jax.numpy as jnp
from toy import Coasting

from dronecombat_jax.adapters.brax_env import CombatEnv
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.types import ATTACKER, EnvState

SIZE = 8  # fights side by side


LENGTH = 20  # control steps until time-out


HOLD = jnp.asarray([0.5, 0.0, 0.0, 0.0])  # a drone that coasts keeps its velocity


def hold(state: EnvState, observation: jax.Array, key: jax.Array) -> jax.Array:
    return jnp.tile(HOLD, (state.clock.shape[0], 1))


def wander(state: EnvState, observation: jax.Array, key: jax.Array) -> jax.Array:
    """Depends on all it is given."""
    return 0.3 * jax.random.normal(key, (state.clock.shape[0], 4)) + 0.01 * (
        state.qpos[:, :4] + observation[:, 0, 7:11]
    )


def make(role: int = ATTACKER, opponent=hold, **game) -> CombatEnv:
    return CombatEnv(
        Coasting(Config(game=GameConfig(**{"episode_steps": LENGTH} | game))), role, opponent
    )
