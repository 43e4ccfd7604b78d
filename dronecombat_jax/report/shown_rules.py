"""What a replay page must know of the game that was flown.

What does not live here: the rules themselves (`combat.rules`), the fights (`replay_data`).
"""

from typing import Any, NamedTuple

from dronecombat_jax.combat.games import game_of
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.combat.starts import ARENA_HALF_WIDTH
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.sides import team
from dronecombat_jax.sim.inverse import full_thrust
from dronecombat_jax.sim.scene import Scene
from dronecombat_jax.types import ATTACKER, DEFENDER, Outcome


class Rules(NamedTuple):
    """What a page must know of the game."""

    intercept_radius: float  # m
    reach_radius: float  # m
    crash_altitude: float  # m
    thrust: tuple[float, float]  # N, full, by side: team mates are alike
    weight: tuple[float, float]  # N, by side
    winners: tuple[Outcome, ...]  # by `Cause`
    alone: bool  # the attackers fly alone
    four_thrusts: bool = False  # an action is four rotors' thrusts
    swept: bool = True  # what happens between two states counts


def rules_of(config: Config, scene: Scene) -> Rules:
    """The rules of `config` with the body of `scene`."""
    game = config.game
    first = [team(game.sides, side).start for side in (DEFENDER, ATTACKER)]
    weight = (float(scene.weight[first[0]]), float(scene.weight[first[1]]))
    return Rules(
        intercept_radius=game.intercept_radius,
        reach_radius=game.reach_radius,
        crash_altitude=game.crash_altitude,
        thrust=(_full_thrust(config, scene, first[0]), _full_thrust(config, scene, first[1])),
        weight=weight,
        winners=outcome_table(game),
        alone=not game_of(config).flies[DEFENDER],
        four_thrusts=config.sim.actuation == "rotors",
        swept=game.swept_events,
    )


def _full_thrust(config: Config, scene: Scene, drone: int) -> float:
    """N at full command; that of rotors where they are flown."""
    if config.sim.actuation == "wrench":
        return config.sim.thrust_to_weight * float(scene.weight[drone])
    return full_thrust(config.sim, scene, drone)


def rules_data(rules: Rules) -> dict[str, Any]:
    """The rules as a page's script reads them."""
    return {
        "arena": ARENA_HALF_WIDTH,
        "intercept": rules.intercept_radius,
        "reach": rules.reach_radius,
        "thrust": rules.thrust,
        "weight": rules.weight,
    }
