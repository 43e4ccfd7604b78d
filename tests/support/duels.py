"""Fights that nobody flew: two drones on smooth paths, for the tests of what shows a fight."""

import numpy as np

from dronecombat_jax.report.replay_data import Fight, Rules
from dronecombat_jax.types import Cause, Outcome, Trajectory

CONTROL_DT = 0.02
TARGET = (5.0, 5.0, 1.0)
RULES = Rules(
    intercept_radius=0.5,
    reach_radius=0.5,
    crash_altitude=0.2,
    thrust=(0.5256, 0.5256),
    weight=(0.2766, 0.2766),
    winners=tuple(
        Outcome.DEFENDER if cause == Cause.INTERCEPT else Outcome.DRAW for cause in Cause
    ),
    alone=False,
)


def duel(steps: int = 100, cause: Cause = Cause.INTERCEPT, seed: int = 0) -> Trajectory:
    """The attacker flies from (0, 0), the defender from (0, 5) to meet it; both turn."""
    rng = np.random.default_rng(seed)
    time = CONTROL_DT * np.arange(steps + 1)
    share = (time / max(time[-1], CONTROL_DT))[:, None]
    meeting = np.array([3.0, 3.0, 1.5]) + rng.uniform(-0.5, 0.5, 3)
    starts = np.array([[0.0, 5.0, 1.0], [0.0, 0.0, 0.8]])
    qpos, qvel = np.zeros((steps + 1, 2, 7)), np.zeros((steps + 1, 2, 6))
    for drone, start in enumerate(starts):
        away = np.array([0.0, 0.2, 0.0]) if drone else 0.0
        qpos[:, drone, :3] = start + share**2 * (meeting + away - start)
        qvel[:, drone, :3] = np.gradient(qpos[:, drone, :3], CONTROL_DT, axis=0) if steps else 0.0
        turn = 0.5 * (1 + drone) * share[:, 0]
        qpos[:, drone, 3], qpos[:, drone, 6] = np.cos(turn / 2), np.sin(turn / 2)
    action = rng.uniform(-1, 1, (steps + 1, 2, 4))
    flat = lambda values: values.reshape(steps + 1, -1)
    return Trajectory(
        time, flat(qpos), flat(qvel), action, np.array(TARGET), int(cause), CONTROL_DT
    )


def fights(count: int, steps: int = 100, name: str = "Fight") -> list[Fight]:
    """So many of them, each another."""
    pilots = (f"{name} defender", f"{name} attacker")
    return [Fight(duel(steps, seed=seed), f"{name} {seed + 1}", pilots) for seed in range(count)]
