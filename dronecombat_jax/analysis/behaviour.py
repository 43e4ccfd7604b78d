"""How fights end and how they are flown, beside who wins them."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.analysis.result import TournamentResult
from dronecombat_jax.config.sides import DUEL, Sides, team
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause, FightRecord


class Endings(NamedTuple):
    """How one side's entrants' fights end; N is D or A."""

    # [N, C] of the played fights, by `Cause`; NaN for an entrant that played none
    share: NDArray[np.float64]
    fights: NDArray[np.integer]  # [N]
    time: NDArray[np.float64]  # [N, C] mean time to that end, s; NaN where it did not happen
    duration: NDArray[np.float64]  # [N, 3] quartiles of the duration of all fights, s


class Flight(NamedTuple):
    """How E recorded fights were flown; [E, 2]: defender's side, attacker's side, of a team the mean
    over its drones, each as long as it flew.
    """

    time: NDArray[np.float64]  # [E] s, to the end
    # [E] m/s, at which the distance of two opponents shrinks at the end: of those nearest to each
    # other
    closing_speed: NDArray[np.float64]
    approach_angle: NDArray[
        np.float64
    ]  # [E] rad, of their velocities at the end: 0 a tail chase, pi head on; NaN at rest
    altitude: NDArray[np.float64]  # [E, 2] m, mean
    lowest: NDArray[np.float64]  # [E, 2] m, of the lowest drone
    # [E, 2] length flown over distance between its ends; NaN at rest
    path_ratio: NDArray[np.float64]
    control_effort: NDArray[np.float64]  # [E, 2] mean over steps of |u|^2, u in [-1, 1]^4


def endings(result: TournamentResult, role: int) -> Endings:
    """How the fights of each defender or attacker (`role`) end, over all its opponents."""
    lead = lambda values: values if role == DEFENDER else np.swapaxes(values, 0, 1)
    cause, steps, played = lead(result.cause), lead(result.steps), lead(result.played)
    size, seconds = len(cause), steps.reshape(len(cause), -1) * result.control_dt
    counts = lead(result.counts).sum(axis=1)
    fights = played.sum(axis=1) * result.cause.shape[2]
    index = np.arange(size)[:, None] * len(Cause) + cause.reshape(size, -1)
    total = np.bincount(
        index.reshape(-1), seconds.reshape(-1), minlength=size * len(Cause)
    ).reshape(size, len(Cause))
    quartiles = np.full((size, 3), np.nan)
    for fight_index in np.flatnonzero(fights):
        quartiles[fight_index] = np.quantile(
            (steps[fight_index] * result.control_dt)[played[fight_index]], [0.25, 0.5, 0.75]
        )
    with np.errstate(invalid="ignore"):  # 0 / 0 is the NaN that is promised
        return Endings(
            counts / fights[:, None],
            fights,
            np.where(counts > 0, total, np.nan) / counts,
            quartiles,
        )


def flight(record: FightRecord, control_dt: float, sides: Sides = DUEL) -> Flight:
    """Describe recorded fights; `control_dt` in s, `sides` that of each drone. After a fight's end its
    last state repeats, which moves no mean.
    """
    steps = np.asarray(record.result.steps)
    fights, drones = np.arange(len(steps)), len(sides)
    position, velocity = _drones(record.qpos, drones, 7), _drones(record.qvel, drones, 6)
    # [T + 1, E, A, 3]
    position = np.concatenate([_drones(np.asarray(record.start.qpos)[None], drones, 7), position])
    pair = fights[:, None], _nearest(position[steps, fights], sides)  # [E], [E, 2]
    last_position, last_velocity = position[steps, fights][pair], velocity[steps - 1, fights][pair]
    line = last_position[:, ATTACKER] - last_position[:, DEFENDER]
    drift = last_velocity[:, ATTACKER] - last_velocity[:, DEFENDER]
    flown = np.repeat((np.arange(1, len(position))[:, None] <= steps)[:, :, None], drones, axis=2)
    if record.down is not None:  # up to and with the step in which a drone of a team goes down
        flown &= ~np.concatenate([np.asarray(record.start.down)[None], record.down[:-1]])
    count = flown.sum(axis=0)
    length = (np.linalg.norm(np.diff(position, axis=0), axis=-1) * flown).sum(axis=0)
    straight = np.linalg.norm(_after(position, count) - position[0], axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = lambda values: _by_side(np.sum(values * flown, axis=0) / count, sides)
        ratio = _by_side(length / straight, sides)
    lowest = position[..., 2].min(axis=0)
    return Flight(
        time=steps * control_dt,
        closing_speed=-_dot(line, drift) / np.maximum(np.linalg.norm(line, axis=-1), 1e-9),
        approach_angle=_angle(last_velocity[:, DEFENDER], last_velocity[:, ATTACKER]),
        altitude=mean(position[1:, :, :, 2]),
        lowest=np.stack([lowest[:, team(sides, s)].min(axis=1) for s in (DEFENDER, ATTACKER)], 1),
        path_ratio=ratio,
        control_effort=mean(np.sum(np.asarray(record.action, float) ** 2, axis=-1)),
    )


def _after(position: NDArray[np.float64], count: NDArray[np.integer]) -> NDArray[np.float64]:
    """Where each drone was after the last step that it flew: of `position` [T + 1, E, A, 3], `count`
    [E, A] steps.
    """
    return np.take_along_axis(position, count[None, :, :, None], axis=0)[0]


def _nearest(position: NDArray[np.float64], sides: Sides) -> NDArray[np.integer]:
    """The defender and the attacker that are nearest to each other, [E, 2], at `position` [E, A, 3]."""
    defend, attack = (position[:, team(sides, side)] for side in (DEFENDER, ATTACKER))
    away = np.linalg.norm(defend[:, :, None] - attack[:, None], axis=-1)
    defender, attacker = np.divmod(away.reshape(len(away), -1).argmin(axis=1), attack.shape[1])
    return np.stack([defender, attacker + defend.shape[1]], axis=1)


def _by_side(values: NDArray[np.float64], sides: Sides) -> NDArray[np.float64]:
    """Means over each side's drones, [E, 2], of values [E, A]; NaN where none is known."""
    means = []
    for side in (DEFENDER, ATTACKER):
        own = values[:, team(sides, side)]
        known = np.isfinite(own)
        with np.errstate(invalid="ignore"):
            means.append(np.where(known, own, 0.0).sum(axis=1) / known.sum(axis=1))
    return np.stack(means, axis=1)


def _drones(values: Any, drones: int, width: int) -> NDArray[np.float64]:
    """The first three of each drone's `width` coordinates: [T, E, A, 3]."""
    values = np.asarray(values, float)
    return values.reshape(*values.shape[:-1], drones, width)[..., :3]


def _dot(first: NDArray[Any], second: NDArray[Any]) -> NDArray[Any]:
    return np.sum(first * second, axis=-1)


def _angle(first: NDArray[Any], second: NDArray[Any]) -> NDArray[np.float64]:
    norms = np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1)
    cosine = np.clip(_dot(first, second) / np.where(norms > 0, norms, 1.0), -1.0, 1.0)
    return np.where(norms > 0, np.arccos(cosine), np.nan)
