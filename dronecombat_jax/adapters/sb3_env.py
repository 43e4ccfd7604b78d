"""The vector view for Stable-Baselines3.

    fights = CombatVectorEnv(combat, "attacker", None, 64, AutoresetMode.SAME_STEP)
    model = PPO("MlpPolicy", VecMonitor(to_sb3(fights)))

In here: the translation of one protocol into the other. Not in here: any fight (`gymnasium_env`).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from dronecombat_jax.adapters.extras import missing

try:
    from gymnasium.vector import AutoresetMode, VectorEnv
    from stable_baselines3.common.vec_env import VecEnv  # pyright: ignore[reportMissingImports]
except ImportError:
    raise missing("stable-baselines3", "sb3") from None

from dronecombat_jax.errors import UserError


def to_sb3(vector_env: VectorEnv) -> "Fights":
    """A Stable-Baselines3 `VecEnv` of a Gymnasium vector environment.

    Its infos hold `terminal_observation` and `TimeLimit.truncated` at every end, as
    Stable-Baselines3 reads them, and all of `final_info`. Raises UserError for an environment that
    does not begin anew in the same step, as Stable-Baselines3 needs it.
    """
    mode = vector_env.metadata.get("autoreset_mode")
    if mode != AutoresetMode.SAME_STEP:
        named = mode.name if isinstance(mode, AutoresetMode) else mode
        raise UserError(f"autoreset_mode = {named}: Stable-Baselines3 needs SAME_STEP")
    return Fights(vector_env)


class Fights(VecEnv):
    """N environments of a Gymnasium vector environment, as Stable-Baselines3 steps them."""

    def __init__(self, vector_env: VectorEnv):
        self.vector_env = vector_env
        self._actions: np.ndarray | None = None
        super().__init__(
            vector_env.num_envs,
            vector_env.single_observation_space,
            vector_env.single_action_space,
        )

    def reset(self) -> Any:
        """Begin all; observations [N, ...]. The seed of `seed` counts once."""
        seed = self._seeds[0]
        observation, _ = self.vector_env.reset(seed=seed)
        self.reset_infos = [{} for _ in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[Any, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Observations [N, ...], rewards [N], dones [N], one info each."""
        observation, reward, terminated, truncated, infos = self.vector_env.step(self._actions)
        ends: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        over = np.asarray(terminated) | np.asarray(truncated)
        for index in np.flatnonzero(over):
            ends[index] = _of_one(infos["final_info"], index) | {
                "terminal_observation": infos["final_obs"][index],
                "TimeLimit.truncated": bool(truncated[index] and not terminated[index]),
            }
        return observation, np.asarray(reward, np.float32), over, ends

    def close(self) -> None:
        self.vector_env.close()

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Set the seed of the next `reset`; fight i of a seed is drawn for itself."""
        if seed is None:
            seed = int(np.random.default_rng().integers(2**31))
        self._seeds = [seed] * self.num_envs
        return self._seeds

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The vector environment's attribute, once for each index: all fights share it."""
        return [getattr(self.vector_env, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise UserError(f"set_attr({attr_name}): the fights share their attributes")

    def env_method(
        self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any
    ) -> list[Any]:
        raise UserError(f"env_method({method_name}): no fight is an environment of its own")

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """No fight has a wrapper of its own."""
        return [False] * len(list(self._get_indices(indices)))


def _of_one(infos: dict[str, Any], index: Any) -> dict[str, Any]:
    """What vectorised infos say of one environment."""
    info = {}
    for name, values in infos.items():
        mask = infos.get(f"_{name}")
        if name.startswith("_") or (mask is not None and not mask[index]):
            continue
        value = _of_one(values, index) if isinstance(values, dict) else values[index]
        info[name] = value.item() if isinstance(value, np.generic) else value
    return info
