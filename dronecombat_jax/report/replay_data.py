"""Fights as the plain data of a replay page: states packed into int16, events, and who wins why.

What does not live here: the page around them (`replay_page`), its reader (`viewer/src/flight.js`).
"""

import base64
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.sides import DUEL
from dronecombat_jax.report.drawn_fight import finite_part
from dronecombat_jax.report.endings import WINNERS, caption, shown_names, verdict
from dronecombat_jax.report.fight_events import fight_events
from dronecombat_jax.report.shown_rules import Rules, rules_data
from dronecombat_jax.sim.actuation import SIGNS
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause, Trajectory

# of two drones in all fights of a page together: 0.6 MB; longer fights, and larger teams, keep every
# n-th state
MOST_STATES = 8192
STEPS = 32767  # of an int16 on either side of 0


class Fight(NamedTuple):
    """One fight of a page."""

    trajectory: Trajectory
    name: str  # such as "Fight 1"
    pilots: tuple[str, str]  # who flies, by role
    note: str = ""  # stands beside the name


def as_sticks(action: np.ndarray) -> np.ndarray:
    """Four rotors' thrusts [..., 4] as a page shows actions: collective, and shares of the moments."""
    return np.concatenate([action.mean(axis=-1, keepdims=True), action @ SIGNS / 4.0], axis=-1)


def replay_data(title: str, about: str, fights: Sequence[Fight], rules: Rules) -> dict[str, Any]:
    """All that a page shows, as plain JSON. UserError 3 for an empty or malformed trajectory."""
    if not fights:
        raise ValueError("a replay needs a fight")
    drones = max(len(fight.trajectory.sides) for fight in fights)
    most = max(2, 2 * MOST_STATES // (drones * len(fights)))
    return {
        "title": title,
        "about": about,
        "rules": rules_data(rules),
        "fights": [fight_data(fight, rules, most) for fight in fights],
    }


def fight_data(fight: Fight, rules: Rules, most: int) -> dict[str, Any]:
    """One fight of a page, of at most `most` states. UserError 3 where the trajectory is malformed."""
    trajectory = finite_part(fight.trajectory)
    kept = _kept(len(trajectory.time), most)
    sides = trajectory.sides
    positions = trajectory.qpos.reshape(-1, len(sides), 7)[kept, :, :3]
    velocities = trajectory.qvel.reshape(-1, len(sides), 6)[kept, :, :3]
    extent, fastest = _scale(positions), _scale(velocities)
    cause, winner = Cause(trajectory.cause), rules.winners[trajectory.cause]
    end = float(trajectory.time[-1])
    every = int(kept[1]) if len(kept) > 1 else 1
    teams = {} if sides == DUEL else {"sides": sides, "names": shown_names(sides)}
    drawn = {name: np.round(each, 4).tolist() for name, each in (trajectory.drawn or {}).items()}
    return {
        **({"drawn": drawn} if drawn else {}),
        "name": one_line(fight.name),
        "note": one_line(fight.note),
        "defender": one_line(fight.pilots[DEFENDER]),
        "attacker": one_line(fight.pilots[ATTACKER]),
        "alone": rules.alone,
        **teams,
        "dt": every * trajectory.control_dt,
        "frames": len(kept),
        "extent": extent,
        "fastest": fastest,
        "target": trajectory.target.tolist(),
        "result": {
            "winner": WINNERS[winner],
            "text": caption(cause, sides)[0],
            "sentence": verdict(cause, winner, end, sides),
            "time": end,
        },
        "events": fight_events(trajectory, winner, rules),
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
    drones = len(trajectory.sides)
    poses = trajectory.qpos.reshape(-1, drones, 7)[kept]
    velocities = trajectory.qvel.reshape(-1, drones, 6)[kept, :, :3]
    actions = np.nan_to_num(np.asarray(trajectory.action, float)[kept])
    if rules.four_thrusts:
        actions = as_sticks(actions)
    parts = [poses[..., :3] / extent, poses[..., 3:], velocities / fastest, actions]
    shares = np.clip(np.concatenate(parts, axis=-1), -1.0, 1.0)
    return base64.b64encode(np.rint(STEPS * shares).astype("<i2").tobytes()).decode()


def _scale(values: np.ndarray) -> float:
    """The largest number, which the largest int16 stands for."""
    return max(float(np.abs(values).max()), 1e-6)
