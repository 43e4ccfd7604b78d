"""Fights as the plain data of a replay page: states packed into int16, events, and who wins why.

What does not live here: the page around them (`replay_page`), its reader (`viewer/src/flight.js`).
"""

import base64
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from dronecombat_jax.combat.games import game_of
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.combat.starts import ARENA_HALF_WIDTH
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.report.video import CAPTIONS, finite_part
from dronecombat_jax.sim.actuation import SIGNS
from dronecombat_jax.sim.inverse import full_thrust
from dronecombat_jax.sim.scene import Scene
from dronecombat_jax.types import ATTACKER, DEFENDER, NUM_SIDES, SIDES, Cause, Outcome, Trajectory

MOST_STATES = 8192  # of all fights of a page together: 0.6 MB; longer fights keep every n-th state
STEPS = 32767  # of an int16 on either side of 0
WINNERS = {Outcome.DEFENDER: "defender", Outcome.ATTACKER: "attacker", Outcome.DRAW: "nobody"}
Event = dict[str, Any]
_REASONS = {
    Cause.NONE: "the fight was cut short",
    Cause.INTERCEPT: "it intercepts the attacker",
    Cause.REACHED: "it reaches the target",
    Cause.DEFENDER_CRASH: "the defender crashes",
    Cause.ATTACKER_CRASH: "the attacker crashes",
    Cause.BOTH_CRASH: "both drones crash",
    Cause.TIMEOUT: "time runs out",
    Cause.DIVERGED: "the simulation diverges",
    Cause.DEFENDER_INVALID: "the defender's action is not a number",
    Cause.ATTACKER_INVALID: "the attacker's action is not a number",
    Cause.BOTH_INVALID: "no action is a number",
}
_CRASHES = {
    Cause.DEFENDER_CRASH: (DEFENDER,),
    Cause.ATTACKER_CRASH: (ATTACKER,),
    Cause.BOTH_CRASH: (DEFENDER, ATTACKER),
}


class Fight(NamedTuple):
    """One fight of a page."""

    trajectory: Trajectory
    name: str  # such as "Fight 1"
    pilots: tuple[str, str]  # who flies, by role
    note: str = ""  # stands beside the name


class Rules(NamedTuple):
    """What a page must know of the game."""

    intercept_radius: float  # m
    reach_radius: float  # m
    crash_altitude: float  # m
    thrust: tuple[float, float]  # N, full, by role
    weight: tuple[float, float]  # N, by role
    winners: tuple[Outcome, ...]  # by `Cause`
    alone: bool  # the attacker flies alone
    four_thrusts: bool = False  # an action is four rotors' thrusts


def rules_of(config: Config, scene: Scene) -> Rules:
    """The rules of `config` with the body of `scene`."""
    game = config.game
    weight = (float(scene.weight[DEFENDER]), float(scene.weight[ATTACKER]))
    return Rules(
        intercept_radius=game.intercept_radius,
        reach_radius=game.reach_radius,
        crash_altitude=game.crash_altitude,
        thrust=(_full_thrust(config, scene, 0), _full_thrust(config, scene, 1)),
        weight=weight,
        winners=outcome_table(game),
        alone=not game_of(config).flies[DEFENDER],
        four_thrusts=config.sim.actuation == "rotors",
    )


def _full_thrust(config: Config, scene: Scene, role: int) -> float:
    """N at full command; that of rotors where they are flown."""
    if config.sim.actuation == "wrench":
        return config.sim.thrust_to_weight * float(scene.weight[role])
    return full_thrust(config.sim, scene, role)


def as_sticks(action: np.ndarray) -> np.ndarray:
    """Four rotors' thrusts [..., 4] as a page shows actions: collective, and shares of the moments."""
    return np.concatenate([action.mean(axis=-1, keepdims=True), action @ SIGNS / 4.0], axis=-1)


def replay_data(title: str, about: str, fights: Sequence[Fight], rules: Rules) -> dict[str, Any]:
    """All that a page shows, as plain JSON. UserError 3 for an empty or malformed trajectory."""
    if not fights:
        raise ValueError("a replay needs a fight")
    most = max(2, MOST_STATES // len(fights))
    return {
        "title": title,
        "about": about,
        "rules": rules_data(rules),
        "fights": [fight_data(fight, rules, most) for fight in fights],
    }


def rules_data(rules: Rules) -> dict[str, Any]:
    """The rules as a page's script reads them."""
    return {
        "arena": ARENA_HALF_WIDTH,
        "intercept": rules.intercept_radius,
        "reach": rules.reach_radius,
        "thrust": rules.thrust,
        "weight": rules.weight,
    }


def verdict(cause: Cause, winner: Outcome, end: float) -> str:
    """Who wins and why, as one sentence; `end` in s."""
    reason = who_and_why(cause, winner)
    return reason if cause == Cause.NONE else f"{reason} after {end:.2f}\u00a0s"


def who_and_why(cause: Cause, winner: Outcome) -> str:
    """The same without the time."""
    if cause == Cause.NONE:
        return f"No result: {_REASONS[cause]}"
    who = "Nobody wins" if winner == Outcome.DRAW else f"{WINNERS[winner].capitalize()} wins"
    return f"{who}: {_REASONS[cause]}"


def fight_data(fight: Fight, rules: Rules, most: int) -> dict[str, Any]:
    """One fight of a page, of at most `most` states. UserError 3 where the trajectory is malformed."""
    trajectory = finite_part(fight.trajectory)
    kept = _kept(len(trajectory.time), most)
    positions = trajectory.qpos.reshape(-1, NUM_SIDES, 7)[kept, :, :3]
    velocities = trajectory.qvel.reshape(-1, NUM_SIDES, 6)[kept, :, :3]
    extent, fastest = _scale(positions), _scale(velocities)
    cause, winner = Cause(trajectory.cause), rules.winners[trajectory.cause]
    end = float(trajectory.time[-1])
    every = int(kept[1]) if len(kept) > 1 else 1
    drawn = {name: np.round(each, 4).tolist() for name, each in (trajectory.drawn or {}).items()}
    return {
        **({"drawn": drawn} if drawn else {}),
        "name": one_line(fight.name),
        "note": one_line(fight.note),
        "defender": one_line(fight.pilots[DEFENDER]),
        "attacker": one_line(fight.pilots[ATTACKER]),
        "alone": rules.alone,
        "dt": every * trajectory.control_dt,
        "frames": len(kept),
        "extent": extent,
        "fastest": fastest,
        "target": trajectory.target.tolist(),
        "result": {
            "winner": WINNERS[winner],
            "text": CAPTIONS[cause][0],
            "sentence": verdict(cause, winner, end),
            "time": end,
        },
        "events": _events(trajectory, cause, winner, rules),
        "states": _pack(trajectory, kept, extent, fastest, rules),
    }


def _kept(states: int, most: int) -> np.ndarray:
    """Indices of the states to keep, at most `most`: every n-th, and the last."""
    every = max(1, -(-(states - 1) // (most - 1)))
    return np.unique(np.append(np.arange(0, states, every), states - 1))


def _pack(
    trajectory: Trajectory, kept: np.ndarray, extent: float, fastest: float, rules: Rules
) -> str:
    """Base64 of little-endian int16 [T, A, 14], in shares of their scale.

    Position 3, quaternion wxyz 4, velocity 3, action 4.
    """
    poses = trajectory.qpos.reshape(-1, NUM_SIDES, 7)[kept]
    velocities = trajectory.qvel.reshape(-1, NUM_SIDES, 6)[kept, :, :3]
    actions = np.nan_to_num(np.asarray(trajectory.action, float)[kept])
    if rules.four_thrusts:
        actions = as_sticks(actions)
    parts = [poses[..., :3] / extent, poses[..., 3:], velocities / fastest, actions]
    shares = np.clip(np.concatenate(parts, axis=-1), -1.0, 1.0)
    return base64.b64encode(np.rint(STEPS * shares).astype("<i2").tobytes()).decode()


def _scale(values: np.ndarray) -> float:
    """The largest number, which the largest int16 stands for."""
    return max(float(np.abs(values).max()), 1e-6)


def _events(trajectory: Trajectory, cause: Cause, winner: Outcome, rules: Rules) -> list[Event]:
    """What happened, in order of time: drones that went down on the way, and the end."""
    positions = trajectory.qpos.reshape(-1, NUM_SIDES, 7)[..., :3]
    end = float(trajectory.time[-1])
    final = _CRASHES.get(cause, ())
    events = []
    for role in (ATTACKER,) if rules.alone else (DEFENDER, ATTACKER):
        height = positions[1:, role, 2]  # the start is no event
        low = 1 + np.flatnonzero(height < rules.crash_altitude)
        if not low.size or (role in final and trajectory.time[low[0]] >= end):
            continue
        when, name = int(low[0]), SIDES[role]
        text, place = f"{name.capitalize()} crashes", positions[when, role]
        events.append(_event("crash", trajectory, when, text, name, place, (role,)))
    place = {Cause.INTERCEPT: positions[-1].mean(axis=0), Cause.REACHED: positions[-1, ATTACKER]}
    where = place.get(cause, positions[-1, final[0] if final else ATTACKER])
    kind, last = "crash" if final else "end", len(positions) - 1
    ended = _event(kind, trajectory, last, CAPTIONS[cause][0], WINNERS[winner], where, final)
    return [*sorted(events, key=lambda event: event["time"]), ended]


def _event(
    kind: str,
    trajectory: Trajectory,
    index: int,
    text: str,
    colour: str,
    place: np.ndarray,
    roles: Sequence[int],
) -> Event:
    colour = "neutral" if colour == "nobody" else colour
    return {
        "kind": kind,
        "time": float(trajectory.time[index]),
        "text": text,
        "colour": colour,
        "place": np.round(place, 4).tolist(),
        "roles": list(roles),
    }
