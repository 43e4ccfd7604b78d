"""A reward for the way to one's goal, beside the game's own: progress, in metres.

A step earns w (d(before) - d(after)), d being a drone's distance to its goal: what drone racing learns by
(Song et al. 2021; Kaufmann et al. 2023). Over a fight it adds up to w times the metres that the drone is
nearer in the end than at the start. It is for learning alone: no part of what is reported as reward or return,
nor of who wins. Potential-based shaping (Ng, Harada and Russell 1999) would take all of it back at the end
and leave the best policies exactly the best; but where the end is a crash far away, that pays for crashing,
and both sides then crash for millions of steps before the value function knows better (docs/strength.md).
Plain arrays of one fight.
"""

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.guidance import post
from dronecombat_jax.combat.reward import goals
from dronecombat_jax.config.fields import Config
from dronecombat_jax.sim.flight import split
from dronecombat_jax.types import DEFENDER, EnvState, StepOutput


def progress(
    config: Config, before: EnvState, after: EnvState, output: StepOutput
) -> jax.Array | None:
    """What a step [A] earns that led from `before` to `after`, which is not reset yet; None where both
    weights are 0. A drone whose action had no effect earns nothing.
    """
    learn, game = config.learn, config.game
    each = learn.defender_progress, learn.attacker_progress
    if not any(each):
        return None
    weights = jnp.asarray([each[side] for side in game.sides])

    def distance(state: EnvState) -> jax.Array:
        drones = split(state.qpos, state.qvel)
        there = goals(game, drones, state.target, before.down)
        if learn.defender_post:
            defends = (jnp.asarray(game.sides) == DEFENDER)[:, None]
            there = jnp.where(defends, post(there, state.target, learn.defender_post), there)
        return jnp.linalg.norm(drones.position - there, axis=-1)

    return jnp.where(output.active, weights * (distance(before) - distance(after)), 0.0)
