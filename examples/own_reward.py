"""A game of one's own: the duel, but quick interceptions pay more, and crashes cost more.

dronecombat train --preset smoke --game.scenario own_reward:SPRINT
"""

import jax.numpy as jnp

import dronecombat_jax as dc
from dronecombat_jax.combat.games import DUEL
from dronecombat_jax.combat.rules import Events
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.types import Cause, Drones, RewardTerms


def quick(config: Config, drones: Drones, target, events: Events, down, cause) -> RewardTerms:
    """The terms of the duel [A]; what a crash costs is doubled, and closing speed is paid."""
    terms = DUEL.reward(config, drones, target, events, down, cause)
    gap = drones.position[1] - drones.position[0]
    closing = -jnp.dot(gap, drones.velocity[1] - drones.velocity[0]) / jnp.linalg.norm(gap)
    paid = config.control_dt * jnp.stack([closing, 0.0]) * ~jnp.any(down)
    return terms._replace(approach=terms.approach + paid, crash=2.0 * terms.crash)


def judge(game: GameConfig, events: Events):
    """As in the duel, but a hit counts before an interception in the same step."""
    return jnp.where(events.reached, Cause.REACHED, DUEL.judge(game, events)).astype(jnp.int32)


SPRINT = DUEL._replace(reward=quick, judge=judge)


def main(preset: str = "smoke") -> None:
    """Train by it."""
    changes = {"run.name": "own-reward", "run.video": False, "game.scenario": "own_reward:SPRINT"}
    print(dc.train(preset, changes))


if __name__ == "__main__":
    main()
