"""The duel in C MuJoCo and NumPy: the MJCF as it is, `mujoco.rollout` on threads, rules and reward
vectorised.

What somebody without MJX would write; `check` compares it with our step. Only what the default
settings play (fights end at a crash, a time-out is a tie, world observation) is in here; no
learning.
"""

from typing import NamedTuple

import mujoco
import mujoco.rollout
import numpy as np

from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.sim.scene import load_scene

PLACES = np.array([[0.0, 5.0], [0.0, 0.0], [5.0, 5.0]])  # m: defender, attacker, target
QPOS, QVEL = slice(1, 15), slice(15, 27)  # in MuJoCo's full physics state; 0 is the time


class Step(NamedTuple):
    """What one control step of N fights yields; agents are 0 defender, 1 attacker."""

    observation: np.ndarray  # [N, 35] after the step; where the fight ended, of the next one
    reward: np.ndarray  # [N, 2]
    terminated: np.ndarray  # [N] bool
    truncated: np.ndarray  # [N] bool


class Duel:
    """N fights side by side, each end followed by a new start."""

    def __init__(self, config: Config, num_envs: int, threads: int, seed: int = 0):
        assert config.game == GameConfig(), "only the default game is written here"
        self._config = config
        self._scene = load_scene(config.sim)
        self._model = self._scene.full
        assert (
            mujoco.mj_stateSize(self._model, int(mujoco.mjtState.mjSTATE_FULLPHYSICS)) == QVEL.stop
        )
        self._low, self._high = self._model.actuator_ctrlrange.T
        self._pool = mujoco.rollout.Rollout(nthread=threads)
        self._data = [mujoco.MjData(self._model) for _ in range(threads)]
        self._random = np.random.default_rng(seed)
        self._path = np.zeros((num_envs, config.sim.substeps, QVEL.stop))
        self.state = np.zeros((num_envs, QVEL.stop))
        self.target = np.zeros((num_envs, 3))
        self.clock = np.zeros(num_envs, np.int64)
        self._spawn(np.ones(num_envs, bool))
        self.clock[:] = self._random.integers(0, config.game.episode_steps, num_envs)

    def observe(self) -> np.ndarray:
        """Observation [N, 35] of eq. 5, float32."""
        pose, twist = self.state[:, QPOS].reshape(-1, 2, 7), self.state[:, QVEL].reshape(-1, 2, 6)
        rotation = _matrices(pose[..., 3:])
        velocity = np.einsum("naij,nai->naj", rotation, twist[..., :3])  # R^T v
        twist = np.concatenate([velocity, twist[..., 3:]], axis=-1)
        size = len(pose)
        parts = (
            pose.reshape(size, 14),
            self.target,
            twist.reshape(size, 12),
            -rotation[..., 2, :].reshape(size, 6),
        )
        return np.concatenate(parts, axis=-1, dtype=np.float32, casting="same_kind")

    def step(self, action: np.ndarray) -> Step:
        """Fly one control step with `action` [N, 2, 4]."""
        before = self._positions()
        self._fly(np.clip(action, -1.0, 1.0).reshape(-1, 8))
        self.clock += 1
        cause = self._judge(before, self._positions())
        reward = self._reward(*cause)
        terminated = np.any(cause[:3], axis=0) | np.any(cause[3], axis=1)
        truncated = (self.clock >= self._config.game.episode_steps) & ~terminated
        self._spawn(terminated | truncated)
        return Step(self.observe(), reward, terminated, truncated)

    def _fly(self, action: np.ndarray) -> None:
        control = self._low + 0.5 * (action + 1.0) * (self._high - self._low)
        substeps = self._config.sim.substeps
        self._pool.rollout(
            self._model, self._data, self.state, control[:, None], nstep=substeps, state=self._path
        )
        flown = self._path[:, -1]
        rate = flown[:, QVEL].reshape(-1, 2, 6)[..., 3:]
        norm = np.linalg.norm(rate, axis=-1, keepdims=True)
        rate *= np.minimum(1.0, self._config.sim.max_body_rate / np.maximum(norm, 1e-6))
        self.state[:] = flown

    def _judge(
        self, before: np.ndarray, after: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Intercepted, reached, both crashed [N], and one crashed alone [N, 2]; at most one of them
        is true.
        """
        game = self._config.game
        near = (
            _closest(before[:, 0] - before[:, 1], after[:, 0] - after[:, 1]) < game.intercept_radius
        )
        hit = (
            _closest(before[:, 1] - self.target, after[:, 1] - self.target) < game.reach_radius
        ) & ~near
        crashed = (after[..., 2] < game.crash_altitude) & ~(near | hit)[:, None]
        both = np.all(crashed, axis=1)
        self._crashed = after[..., 2] < game.crash_altitude  # pays, whatever ended the fight
        return near, hit, both, crashed & ~both[:, None]

    def _reward(
        self, near: np.ndarray, hit: np.ndarray, both: np.ndarray, alone: np.ndarray
    ) -> np.ndarray:
        """Reward [N, 2] of eq. 9-12."""
        weights, positions = self._config.reward, self._positions()
        twist = self.state[:, QVEL].reshape(-1, 2, 6)
        goals = np.stack([positions[:, 1], self.target], axis=1)
        distance = np.linalg.norm(positions - goals, axis=-1)
        scale = (weights.defender_distance_scale, weights.attacker_distance_scale)
        dense = weights.approach_weight * (1.0 - np.tanh(distance / scale))
        dense -= weights.linear_velocity_penalty * np.sum(twist[..., :3] ** 2, axis=-1)
        dense -= weights.angular_velocity_penalty * np.sum(twist[..., 3:] ** 2, axis=-1)
        win = weights.win * np.stack([near, hit], axis=1) + weights.crash_win * alone[:, ::-1]
        lose = np.stack([weights.lose * hit, weights.intercepted * near], axis=1)
        crash = weights.crash_penalty * self._crashed
        return (self._config.control_dt * dense + win - lose - crash).astype(np.float32)

    def _spawn(self, which: np.ndarray) -> None:
        game, count = self._config.game, int(which.sum())
        if not count:
            return
        altitude = self._random.uniform(
            game.spawn_altitude_low, game.spawn_altitude_high, (count, 3, 1)
        )
        places = np.concatenate([np.broadcast_to(PLACES, (count, 3, 2)), altitude], axis=-1)
        fresh = np.zeros((count, QVEL.stop))
        pose = fresh[:, QPOS].reshape(count, 2, 7)  # a view
        pose[..., :3], pose[..., 3] = places[:, :2], 1.0
        self.state[which], self.target[which], self.clock[which] = fresh, places[:, 2], 0

    def _positions(self) -> np.ndarray:
        return self.state[:, QPOS].reshape(-1, 2, 7)[..., :3].copy()


def _matrices(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrices [..., 3, 3], body to world, of unit quaternions wxyz."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    entries = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return np.stack(entries, axis=-1).reshape(*quaternion.shape[:-1], 3, 3)


def _closest(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Smallest distance [N] to the origin along the segments `start` -> `end` [N, 3]."""
    delta = end - start
    along = -np.sum(start * delta, axis=-1) / np.maximum(np.sum(delta * delta, axis=-1), 1e-12)
    return np.linalg.norm(start + np.clip(along, 0.0, 1.0)[:, None] * delta, axis=-1)
