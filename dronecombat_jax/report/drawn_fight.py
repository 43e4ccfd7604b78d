"""What pictures and films read off a fight: who is there, where, who is down, and its numbers.

What does not live here: drawing (`stage`, `video`).
"""

import numpy as np

from dronecombat_jax.config.sides import DUEL, mates, team
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.types import ATTACKER, DEFENDER, SIDES, Trajectory


def finite_part(trajectory: Trajectory) -> Trajectory:
    """The trajectory as float arrays, up to its first state that is not finite."""
    qpos, qvel = np.asarray(trajectory.qpos, float), np.asarray(trajectory.qvel, float)
    time, target = np.asarray(trajectory.time, float), np.asarray(trajectory.target, float)
    steps, drones = len(time), len(trajectory.sides)
    wide, fast = 7 * drones, 6 * drones
    if qpos.shape != (steps, wide) or qvel.shape != (steps, fast) or target.shape != (3,):
        raise UserError(
            f"trajectory: qpos {qpos.shape}, qvel {qvel.shape}, target {target.shape} "
            f"should be ({steps}, {wide}), ({steps}, {fast}), (3,)",
            EXIT_DATA,
        )
    finite = np.isfinite(qpos).all(axis=1) & np.isfinite(qvel).all(axis=1)
    end = steps if finite.all() else int(np.argmin(finite))
    if end == 0 or not np.isfinite(target).all():
        raise UserError("trajectory: no finite state to draw", EXIT_DATA)
    return trajectory._replace(time=time[:end], qpos=qpos[:end], qvel=qvel[:end], target=target)


def interpolate(fight: Trajectory, time: float) -> np.ndarray:
    """qpos [7 A] at `time` in s: positions linear, quaternions along the shorter arc, normalised."""
    after = int(np.clip(np.searchsorted(fight.time, time), 1, max(1, len(fight.time) - 1)))
    if len(fight.time) == 1:
        return fight.qpos[0]
    start, end = fight.time[after - 1], fight.time[after]
    share = float(np.clip((time - start) / (end - start), 0.0, 1.0))
    before = fight.qpos[after - 1].reshape(-1, 7)
    following = fight.qpos[after].reshape(-1, 7).copy()
    following[:, 3:] *= np.where(
        np.sum(before[:, 3:] * following[:, 3:], axis=1, keepdims=True) < 0, -1.0, 1.0
    )
    mixed = (1.0 - share) * before + share * following
    mixed[:, 3:] /= np.maximum(np.linalg.norm(mixed[:, 3:], axis=1, keepdims=True), 1e-9)
    return mixed.reshape(-1)


def present(fight: Trajectory) -> tuple[int, ...]:
    """All drones, or the attackers alone where the defenders never take part (scenario solo)."""
    drones = tuple(range(len(fight.sides)))
    if fight.sides != DUEL:
        defenders = team(fight.sides, DEFENDER)
        return drones[defenders.stop :] if fight.down[0, defenders].all() else drones
    absent = len(fight.qpos) > 1 and not np.any(np.ptp(fight.qpos[:, :3], axis=0) > 1e-6)
    return (ATTACKER,) if absent else drones


def poses(fight: Trajectory, drone: int) -> np.ndarray:
    """[T, 7] of one drone."""
    return fight.qpos[:, 7 * drone : 7 * drone + 7]


def is_down(fight: Trajectory, index: int, drone: int) -> bool:
    """Whether a drone of a team is down at state `index`; a duel's pictures do not tell."""
    return fight.down is not None and bool(fight.down[index, drone])


def watched(fight: Trajectory) -> tuple[int, ...]:
    """Whose chase cameras a film shows: of a team the attacker that came nearest to the target, and
    the defender that came nearest to it.
    """
    if fight.sides == DUEL:
        return present(fight)
    places = fight.qpos.reshape(len(fight.time), -1, 7)[..., :3]
    nearest = lambda among, to: min(
        among, key=lambda drone: np.linalg.norm(places[:, drone] - to, axis=-1).min()
    )
    there = present(fight)
    attacker = nearest([drone for drone in there if fight.sides[drone] == ATTACKER], fight.target)
    defenders = [drone for drone in there if fight.sides[drone] == DEFENDER]
    return (nearest(defenders, places[:, attacker]), attacker) if defenders else (attacker,)


def aim(fight: Trajectory, index: int, qpos: np.ndarray, drone: int) -> np.ndarray:
    """What a drone is after, [3] m: the nearest attacker that flies, or the target."""
    if fight.sides[drone] == ATTACKER:
        return fight.target
    places = qpos.reshape(-1, 7)[:, :3]
    attackers = _flying(fight, index, ATTACKER)
    return min((places[one] for one in attackers), key=lambda x: np.linalg.norm(x - places[drone]))


def numbers(fight: Trajectory, index: int) -> str:
    """Speeds and distances at state `index` in one line; of teams how many fly, and the nearest."""
    places = fight.qpos[index].reshape(-1, 7)[:, :3]
    there = present(fight)
    if fight.sides == DUEL:
        speeds = np.linalg.norm(fight.qvel[index].reshape(-1, 6)[:, :3], axis=1)
        parts = [f"{SIDES[drone]} {speeds[drone]:.1f} m/s" for drone in there]
    else:
        parts = [_counted(fight, index, side) for side in sorted({fight.sides[d] for d in there})]
    attackers = places[_flying(fight, index, ATTACKER)]
    if DEFENDER in there:
        defenders = places[_flying(fight, index, DEFENDER)]
        apart = np.linalg.norm(defenders[:, None] - attackers, axis=-1).min()
        parts.append(f"{apart:.2f} m apart")
    away = np.linalg.norm(attackers - fight.target, axis=-1).min()
    parts.append(f"attacker {away:.2f} m from the target")
    return "   ".join(parts)


def points(fight: Trajectory, reach_radius: float) -> np.ndarray:
    """Everything the arena picture must hold, [K, 3]: floor corners, all paths and the target's
    bubble of `reach_radius` m.
    """
    corners = np.array([[x, y, 0.0] for x in (-5.0, 5.0) for y in (-5.0, 5.0)])
    paths = [poses(fight, drone)[:, :3] for drone in present(fight)]
    bubble = fight.target + reach_radius * np.vstack([np.eye(3), -np.eye(3)])
    return np.vstack([corners, *paths, bubble])


def _counted(fight: Trajectory, index: int, side: int) -> str:
    members = mates(fight.sides, side)
    flying = sum(not is_down(fight, index, drone) for drone in members)
    return f"{flying} of {len(members)} {SIDES[side]}s fly"


def _flying(fight: Trajectory, index: int, side: int) -> list[int]:
    """The drones of a side that fly at state `index`; all of them where none does."""
    members = mates(fight.sides, side)
    return [drone for drone in members if not is_down(fight, index, drone)] or [*members]
