"""A game and its pilots as the plain data of a page on which a person flies.

What does not live here: the page (`play_page`), who flies (`watch.play`), and the JavaScript that
flies it (`viewer/src/sim`).
"""

import base64
from typing import Any, NamedTuple

import numpy as np

from dronecombat_jax.combat.games import DUEL, game_of
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.combat.scripted import PILOTS, PLANNERS
from dronecombat_jax.combat.starts import ARENA_HALF_WIDTH, places
from dronecombat_jax.config.fields import Config, LearnConfig
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.errors import UserError
from dronecombat_jax.learn.mates import only
from dronecombat_jax.learn.memory import memory_size
from dronecombat_jax.learn.normalize import CLIP, EPSILON
from dronecombat_jax.report.endings import WINNERS, who_and_why
from dronecombat_jax.sim.craft import is_ideal
from dronecombat_jax.sim.fluid import drags
from dronecombat_jax.sim.scene import Scene
from dronecombat_jax.types import NUM_SIDES, Cause, SidePolicy

Data = dict[str, Any]
SEEN = ("world", "ego", "engagement", "tracks")  # observations that the page's code knows


class Opponent(NamedTuple):
    """Who flies a side where no person does."""

    label: str
    pilot: SidePolicy | str  # NumPy leaves; or the name of a scripted pilot
    learn: LearnConfig  # how the policy sees
    observation: str = ""  # the layout that it sees; "": that of the page's game


def refuse_unknown_game(config: Config) -> None:
    """Raise UserError for a game that the page's own code does not know."""
    game = config.game
    if game.scenario == "solo":
        raise UserError("game.scenario = solo: a person needs somebody to fly against: a duel")
    if not is_ideal(config):
        raise UserError(
            "the page flies ideal rigid bodies alone: not sim.actuation, sim.drag, sim.gust_speed or "
            "randomise of another kind, no sensor.*. dronecombat replay shows such fights"
        )
    known = {"scenario": game_of(config) is DUEL, "observation": game.observation in SEEN}
    for what in (what for what, is_known in known.items() if not is_known):
        name = one_line(getattr(game, what))
        raise UserError(f"game.{what} = {name}: the page knows duel, {', '.join(SEEN)} alone")


def game_data(config: Config, scene: Scene) -> Data:
    """All that the page's code must know to fly and judge a fight, as plain JSON.

    `mjcf` of one's own is in it: masses, inertias, principal axes, fluid and wind.
    """
    game, sim, winners = config.game, config.sim, outcome_table(config.game)
    spread = game.spawn_spread
    return {
        "flight": {
            "timestep": sim.timestep,
            "substeps": sim.substeps,
            "moment_scale": sim.moment_scale,
            "max_body_rate": sim.max_body_rate,
            "implicit": sim.gyroscopic == "implicit",
            "gravity": float(scene.flown.gravity),
            "wind": [float(speed) for speed in scene.flown.wind],
            "bodies": _bodies(config, scene),
        },
        "rules": {
            "intercept_radius": game.intercept_radius,
            "reach_radius": game.reach_radius,
            "crash_altitude": game.crash_altitude,
            "crash_rule": game.crash_rule,
            "swept_events": game.swept_events,
            "episode_steps": game.episode_steps,
        },
        "start": {
            "places": places(game),
            "uniform": game.spawn == "uniform",
            "half_width": ARENA_HALF_WIDTH,
            "low": game.spawn_altitude_low,
            "high": game.spawn_altitude_high,
            "spread": [max(spread, game.defender_spread), spread, spread],
        },
        "observation": game.observation,
        "ends": [
            {"winner": WINNERS[winners[cause]], "sentence": who_and_why(cause, winners[cause])}
            for cause in Cause
        ],
    }


def opponent_data(opponent: Opponent) -> Data:
    """A pilot as plain JSON; the numbers of a policy are base64 of little-endian float32.

    Their order: mean and divisor of the observation, then weights [in, out] and biases of each
    layer.
    """
    label = one_line(opponent.label)
    if isinstance(opponent.pilot, str):
        if opponent.pilot in PLANNERS.values():
            raise UserError(
                f"{opponent.pilot} looks ahead, which the page's own code cannot: take another "
                "pilot. dronecombat replay shows its fights"
            )
        if not any(opponent.pilot in laws for laws in PILOTS.values()):
            raise UserError(
                f"{opponent.pilot} flies with team mates, and the page has one drone a side: take "
                "another pilot. dronecombat replay shows its fights"
            )
        return {"label": label, "scripted": opponent.pilot}
    policy = only(opponent.pilot, "the page to fly in")
    if memory_size(policy):
        raise UserError(
            f"{label}: the page flies policies without memory alone. dronecombat replay shows its fights"
        )
    if opponent.observation not in ("", *SEEN):
        raise UserError(
            f"{label} sees by {opponent.observation}: the page knows {', '.join(SEEN)} alone. "
            "dronecombat replay shows its fights"
        )
    network, scaler = policy.network, policy.observation_scaler
    divisor = np.sqrt(np.asarray(scaler.variance, np.float32)) + np.float32(EPSILON)
    layers = zip(network.weights, network.biases, strict=True)
    arrays = [scaler.mean, divisor, *(array for layer in layers for array in layer)]
    flat = np.concatenate([np.asarray(array, "<f4").ravel() for array in arrays])
    return {
        "label": label,
        "sizes": [network.weights[0].shape[0], *(bias.shape[0] for bias in network.biases)],
        "normalize": opponent.learn.normalize_observations,
        "clip": CLIP,
        "numbers": base64.b64encode(flat.astype("<f4").tobytes()).decode(),
        **({"observation": opponent.observation} if opponent.observation else {}),
    }


def _bodies(config: Config, scene: Scene) -> list[Data]:
    """Both drones; `axes` by rows, null where they are the body's own; `drag` null in vacuum."""
    fluid = drags(scene.flown) if scene.flown.in_fluid else None
    rows = lambda array, role: np.asarray(array, float)[role].tolist()
    bodies = []
    for role in range(NUM_SIDES):
        drag = fluid and {
            name: {"viscous": rows(kind.viscous, role), "quadratic": rows(kind.quadratic, role)}
            for name, kind in zip(("linear", "angular"), fluid, strict=True)
        }
        bodies.append(
            {
                "mass": float(scene.mass[role]),
                "inertia": rows(scene.inertia, role),
                "axes": None if scene.axes is None else rows(scene.axes, role),
                "full_thrust": config.sim.thrust_to_weight * float(scene.weight[role]),
                "drag": drag,
            }
        )
    return bodies
