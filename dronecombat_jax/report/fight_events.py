"""What happened in a fight, in order of time, as a replay page shows it: who struck whom, who
crashed, and how it ended.

What does not live here: the words of an end (`endings`), the states (`replay_data`).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from dronecombat_jax.combat.rules import closest_approach
from dronecombat_jax.config.sides import DUEL, team
from dronecombat_jax.report.endings import (
    CAPTIONS,
    WINNERS,
    caption,
    sentence_case,
    shown_names,
)
from dronecombat_jax.report.shown_rules import Rules
from dronecombat_jax.types import ATTACKER, DEFENDER, SIDES, Cause, Outcome, Trajectory

Event = dict[str, Any]  # kind, time (s), text, colour, place ([3] m), roles (drones that go down)
_CRASHES = {
    Cause.DEFENDER_CRASH: (DEFENDER,),
    Cause.ATTACKER_CRASH: (ATTACKER,),
    Cause.BOTH_CRASH: (DEFENDER, ATTACKER),
}


def fight_events(trajectory: Trajectory, winner: Outcome, rules: Rules) -> list[Event]:
    """Drones that went down on the way, and the end."""
    if trajectory.sides == DUEL:
        return _duel_events(trajectory, winner, rules)
    return _team_events(trajectory, winner, rules)


def strikers(trajectory: Trajectory, index: int, attacker: int, rules: Rules) -> list[int]:
    """The defenders that struck `attacker` in the step to state `index`.

    A trajectory keeps that it was struck, not by whom: those that had it within the radius, or the
    nearest where rounding leaves none.
    """
    places = _places(trajectory)[index - 1 : index + 1]
    if not rules.swept:
        places = places[[1, 1]]
    mates = team(trajectory.sides, DEFENDER)
    flying = [drone for drone in range(mates.stop) if not trajectory.down[index - 1, drone]]
    if not flying:
        return []
    start, end = places[:, flying] - places[:, [attacker]]
    near = np.asarray(closest_approach(start, end))
    reach = max(rules.intercept_radius, near.min())
    return [drone for drone, away in zip(flying, near, strict=True) if away <= reach]


def _team_events(trajectory: Trajectory, winner: Outcome, rules: Rules) -> list[Event]:
    places, down, struck = _places(trajectory), trajectory.down, trajectory.struck
    names, events = shown_names(trajectory.sides), []
    for before, drone in np.argwhere(down[1:] & ~down[:-1]).tolist():
        index = before + 1
        side = trajectory.sides[drone]
        place = places[index, drone]
        if not struck[index, drone]:
            text = f"{sentence_case(names[drone])} crashes"
            events.append(_event("crash", trajectory, index, text, SIDES[side], place, [drone]))
        elif side == ATTACKER:
            text = _strike(names, strikers(trajectory, index, drone, rules), drone)
            events.append(_event("strike", trajectory, index, text, "defender", place, [drone]))
        else:
            text = f"{sentence_case(names[drone])} goes down with its strike"
            events.append(_event("strike", trajectory, index, text, "attacker", place, [drone]))
    return [*events, _team_end(trajectory, winner)]


def _strike(names: Sequence[str], by: Sequence[int], whom: int) -> str:
    who = " and ".join(names[drone] for drone in by) or "a defender"
    return f"{sentence_case(who)} strike{'s' * (len(by) < 2)} {names[whom]}"


def _team_end(trajectory: Trajectory, winner: Outcome) -> Event:
    cause, places = Cause(trajectory.cause), _places(trajectory)[-1]
    text, _ = caption(cause, trajectory.sides)
    mates = team(trajectory.sides, ATTACKER)
    away = np.linalg.norm(places[mates] - trajectory.target, axis=-1)
    flies = ~trajectory.down[-1, mates]
    nearest = mates.start + int(np.argmin(np.where(flies | ~flies.any(), away, np.inf)))
    if cause == Cause.REACHED:
        text = f"{sentence_case(shown_names(trajectory.sides)[nearest])} reaches the target"
    last = len(trajectory.time) - 1
    return _event("end", trajectory, last, text, WINNERS[winner], places[nearest], ())


def _duel_events(trajectory: Trajectory, winner: Outcome, rules: Rules) -> list[Event]:
    positions, cause = _places(trajectory), Cause(trajectory.cause)
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
        "roles": [int(role) for role in roles],
    }


def _places(trajectory: Trajectory) -> np.ndarray:
    """[T, A, 3] m."""
    return trajectory.qpos.reshape(len(trajectory.time), -1, 7)[..., :3]
