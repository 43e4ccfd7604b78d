"""A reward for the way to one's goal that leaves the game what it is: potential-based shaping.

A step earns F = gamma P(after) - P(before) beside its reward, with the potential P = -w |p - goal|, and
P = 0 once the fight is over or the drone is down. Over a fight this adds up to -P(start), whatever is
flown: the best policies stay the best (Ng, Harada and Russell 1999). It is for learning alone: no part
of what is reported as reward or return. Plain arrays of one fight.
"""

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.reward import goals
from dronecombat_jax.config.fields import Config
from dronecombat_jax.sim.flight import split
from dronecombat_jax.types import EnvState, StepOutput


def shaping(
    config: Config, before: EnvState, after: EnvState, output: StepOutput
) -> jax.Array | None:
    """F [A] of a step that led from `before` to `after`, which is not reset yet; None where both weights
    are 0.
    """
    learn, game = config.learn, config.game
    each = learn.defender_shaping, learn.attacker_shaping
    if not any(each):
        return None
    weights = jnp.asarray([each[side] for side in game.sides])

    def potential(state: EnvState) -> jax.Array:
        drones = split(state.qpos, state.qvel)
        way = drones.position - goals(game, drones, state.target, state.down)
        return -weights * jnp.linalg.norm(way, axis=-1)

    goes_on = ~(output.terminated | after.down)
    gained = learn.discount * jnp.where(goes_on, potential(after), 0.0) - potential(before)
    return jnp.where(output.active, gained, 0.0)
