"""The scenarios: who takes part, and by which rules and rewards. One entry of GAMES for each.

An environment looks its game up once, when it is built (`env.Combat`). To add one, write its
functions in a file beside this, name it in GAMES and among the choices of
`config.GameConfig.scenario`. What does not live here: physics and starts (`env`).
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.reward import reward_terms
from dronecombat_jax.combat.rules import Events, judge
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.config.own import chosen
from dronecombat_jax.config.sides import DUEL as DUEL_SIDES
from dronecombat_jax.config.sides import Sides
from dronecombat_jax.types import Drones, RewardTerms

Judge = Callable[[GameConfig, Events], jax.Array]
Reward = Callable[[Config, Drones, jax.Array, Events, jax.Array, jax.Array], RewardTerms]


class Game(NamedTuple):
    """What a scenario is made of: functions of one fight on plain arrays."""

    flies: tuple[bool, bool]  # whether a side takes part; one that does not learns nothing
    judge: Judge  # (settings, events) -> cause [] int32
    reward: Reward  # (settings, drones, target, events, down [A], cause) -> terms [A]

    def absent(self, sides: Sides = DUEL_SIDES) -> jax.Array:
        """Who stands still at its start and takes no part, [A] bool, of drones of these `sides`."""
        return ~jnp.asarray([self.flies[side] for side in sides])


def judge_alone(game: GameConfig, events: Events) -> jax.Array:
    """The cause for an attacker that flies alone: its crash ends the fight under every rule."""
    return judge(replace(game, crash_rule="ends"), events)


def reward_alone(
    config: Config,
    drones: Drones,
    target: jax.Array,
    events: Events,
    down: jax.Array,
    cause: jax.Array,
) -> RewardTerms:
    """The rewards of the duel with its crash rule `ends`, each term [A]; 0 for who is absent."""
    alone = replace(config, game=replace(config.game, crash_rule="ends"))
    terms = reward_terms(alone, drones, target, events, down, cause)
    return jax.tree.map(lambda term: jnp.where(~SOLO.absent(config.game.sides), term, 0.0), terms)


DUEL = Game(flies=(True, True), judge=judge, reward=reward_terms)
SOLO = Game(flies=(False, True), judge=judge_alone, reward=reward_alone)
GAMES: dict[str, Game] = {"duel": DUEL, "solo": SOLO}


def game_of(config: Config) -> Game:
    """The game that `game.scenario` names."""
    return chosen(GAMES, config.game.scenario)
