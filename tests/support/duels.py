"""Fights that nobody flew: two drones on smooth paths, for the tests of what shows a fight."""

import numpy as np

from dronecombat_jax.report.replay_data import Fight
from dronecombat_jax.report.shown_rules import Rules
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


def two_against_two(steps: int = 100) -> Trajectory:
    """Defenders 0 and 1 along y = 1 and y = -1, attackers 2 and 3 with them, 2 m behind.

    After 40 steps defender 1 meets attacker 3 and takes it out; after 60 defender 0 crashes; at the
    end attacker 2 is at the target.
    """
    time, sides = CONTROL_DT * np.arange(steps + 1), (0, 0, 1, 1)
    places = np.zeros((steps + 1, 4, 3))
    for drone, start in enumerate(
        [(2.0, 1.0, 1.0), (2.0, -1.0, 1.0), (0.0, 1.0, 1.0), (0.0, -1.0, 1.0)]
    ):
        places[:, drone] = start + np.linspace(0.0, 1.0, steps + 1)[:, None] * (
            np.array(TARGET) - start
        )
    meets = int(0.4 * steps)
    places[meets:, 3] = places[meets, 3]
    places[:, 1] = places[:1, 1] + np.minimum(np.arange(steps + 1) / meets, 1.0)[:, None] * (
        places[meets, 3] + np.array([0.1, 0.0, 0.0]) - places[:1, 1])  # fmt: skip
    falls = int(0.6 * steps)
    places[falls:, 0] = places[falls, 0] * np.array([1.0, 1.0, 0.0]) + np.array([0.0, 0.0, 0.1])
    down, struck = np.zeros((steps + 1, 4), bool), np.zeros((steps + 1, 4), bool)
    down[meets:, 3] = struck[meets:, 3] = down[falls:, 0] = True
    qpos, qvel = np.zeros((steps + 1, 4, 7)), np.zeros((steps + 1, 4, 6))
    qpos[..., :3], qpos[..., 3] = places, 1.0
    qvel[..., :3] = np.where(down[..., None], 0.0, np.gradient(places, CONTROL_DT, axis=0))
    flat = lambda values: values.reshape(steps + 1, -1)
    action = np.random.default_rng(0).uniform(-1, 1, (steps + 1, 4, 4))
    return Trajectory(time, flat(qpos), flat(qvel), action, np.array(TARGET), int(Cause.REACHED),
                      CONTROL_DT, sides=sides, down=down, struck=struck)  # fmt: skip
