"""How the checker drives environments that give NumPy arrays: Gymnasium's and PettingZoo's.

Only a library that the caller has imported can have made `env`, so none is imported for its own sake.
"""

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.adapters.conformance.trace import Driver, Look
from dronecombat_jax.errors import UserError


def of_gymnasium(env: Any) -> Driver | None:
    """A driver for a Gymnasium vector environment; None for anything else."""
    if "gymnasium" not in sys.modules:
        return None
    from gymnasium.vector import VectorEnv

    return GymnasiumDriver(env) if isinstance(env, VectorEnv) else None


def of_pettingzoo(env: Any) -> Driver | None:
    """A driver for a PettingZoo parallel environment; None for anything else."""
    if "pettingzoo" not in sys.modules:
        return None
    from pettingzoo import ParallelEnv

    return PettingZooDriver(env) if isinstance(env, ParallelEnv) else None


class GymnasiumDriver(Driver):
    """N fights of one agent, in any autoreset mode."""

    agents = ("the agent",)

    def __init__(self, env: Any):
        super().__init__(env)
        mode = env.metadata.get("autoreset_mode")
        if mode is None:
            self.note("autoreset-mode", "metadata does not declare an autoreset_mode")
        self.mode = getattr(mode, "name", "NEXT_STEP")
        self.number = env.num_envs
        self.spaces = [(env.single_observation_space, env.single_action_space)]
        self.time_limit = _limit(env)
        self._over = np.zeros(self.number, bool)
        self._given: tuple[Any, NDArray] | None = None

    def reset(self, seed: int | None) -> NDArray:
        observation, _ = self.env.reset(seed=seed)
        self._over = np.zeros(self.number, bool)
        return self._keep(observation, "observation")

    def step(self, actions: NDArray) -> Look:
        flown = ~self._over if self.mode == "NEXT_STEP" else np.ones(self.number, bool)
        seen, reward, terminated, truncated, infos = self.env.step(actions[:, 0])
        shape = (self.number,)
        observation = self._keep(seen, "observation")
        terminated = self.require_flags(terminated, "terminated", shape)
        truncated = self.require_flags(truncated, "truncated", shape)
        reward = self.require_reward(reward, shape)
        over = (terminated | truncated) & flown
        final, shown, begun = observation.copy(), over.copy(), ~flown
        if self.mode == "SAME_STEP":
            final, shown, begun = self._final(final, over, infos), self._shown(over, infos), over
        elif self.mode == "DISABLED" and over.any():
            again, _ = self.env.reset(options={"reset_mask": over.copy()})
            observation, begun = self._keep(again, "observation"), over
        self._over = over
        return Look(observation, final, shown, reward[:, None], terminated, truncated, flown, begun)

    def _keep(self, seen: Any, what: str) -> NDArray:
        """A copy [N, 1, ...]; notes what was handed out before and has changed since."""
        if self._given is not None and not np.array_equal(*self._given, equal_nan=True):
            self.note("memory", "an observation that was handed out is written to by a later step")
        array = self.require_space(seen, 0, what)
        self._given = (seen, np.array(seen))
        return np.array(array)[:, None]

    def _shown(self, over: NDArray[np.bool_], infos: dict[str, Any]) -> NDArray[np.bool_]:
        """Which of the fights that ended gave their final observation."""
        final = infos.get("final_obs")
        if final is None:
            return np.zeros(self.number, bool)
        mask = np.asarray(infos.get("_final_obs", over), bool)
        if np.any(mask != over):
            self.note("mask", "infos['_final_obs'] does not mark the fights that ended")
        return over & np.asarray([end is not None for end in final], bool)

    def _final(self, seen: NDArray, over: NDArray[np.bool_], infos: dict[str, Any]) -> NDArray:
        shown = self._shown(over, infos)
        for index in np.flatnonzero(shown):
            end = np.asarray(infos["final_obs"][index])
            seen[index] = self.require_space(end[None], 0, "final observation")
        return seen


class PettingZooDriver(Driver):
    """One fight of several agents; the next begins when all have left."""

    number = 1

    def __init__(self, env: Any):
        super().__init__(env)
        self.agents = tuple(env.possible_agents)
        self.spaces = [
            (env.observation_space(agent), env.action_space(agent)) for agent in self.agents
        ]
        if len({space.shape for space, _ in self.spaces}) > 1:
            raise UserError("check: agents with different observation spaces are not supported")
        self.time_limit = _limit(env)
        self._living: list[str] = []
        self._gone: set[str] = set()

    def reset(self, seed: int | None) -> NDArray:
        observation, infos = self.env.reset(seed=seed)
        self._living, self._gone = list(self.env.agents), set()
        if not self._living:
            raise UserError("check: no agent is there after reset()")
        self._require_keys("observations of reset", observation, self._living)
        self._require_keys("infos of reset", infos, self._living)
        return self._gather(observation, "observation")[None]

    def step(self, actions: NDArray) -> Look:
        acted = list(self._living)
        given = {agent: actions[0, self.agents.index(agent)] for agent in acted}
        observation, rewards, terminated, truncated, infos = self.env.step(given)
        named = {
            "observations": observation, "rewards": rewards, "terminations": terminated,
            "truncations": truncated, "infos": infos,
        }  # fmt: skip
        for name, by_agent in named.items():
            self._require_keys(name, by_agent, acted)
        over = [self._flag(terminated, agent) or self._flag(truncated, agent) for agent in acted]
        self._leave(acted, over)
        final = self._gather(observation, "observation")[None]
        ended = not self._living
        decided = any(self._flag(terminated, agent) for agent in acted)
        reward = np.zeros((1, len(self.agents)))
        for agent in acted:
            reward[0, self.agents.index(agent)] = self.require_reward(rewards.get(agent, 0.0), ())
        following = self.reset(None) if ended else final
        flags = np.full(1, ended)
        return Look(
            following, final, flags & self._all_there(observation, acted), reward,
            flags & decided, flags & (not decided), np.full(1, True), flags,
        )  # fmt: skip

    def _leave(self, acted: list[str], over: list[bool]) -> None:
        """Follow who left; notes agents that stay, come back or leave without an end."""
        self._gone |= {agent for agent, left in zip(acted, over, strict=True) if left}
        expected = [agent for agent in acted if agent not in self._gone]
        if back := set(self.env.agents) & self._gone:
            self.note("revived", f"{', '.join(sorted(back))}: ended, and is among `agents`")
        elif set(self.env.agents) != set(expected):
            self.note("agents", "`agents` is not who acted less who has ended")
        self._living = list(self.env.agents)

    def _require_keys(self, name: str, values: Any, agents: list[str]) -> None:
        """A dict of just the agents that act, but for other keys than agents' names."""
        keys = set(values) & set(self.agents)
        if keys - set(agents):
            rule = "after-the-end" if name == "rewards" else "keys"
            self.note(rule, f"{name} name an agent that has ended")
        elif keys != set(agents):
            self.note("keys", f"{name} lack an agent that acted")

    def _all_there(self, observation: Any, agents: list[str]) -> bool:
        return all(observation.get(agent) is not None for agent in agents)

    def _flag(self, flags: Any, agent: str) -> bool:
        value = flags.get(agent, False)
        if not isinstance(value, bool | np.bool_):
            self.note("dtype", f"a flag of {agent} is {type(value).__name__}, not bool")
        return bool(value)

    def _gather(self, observation: Any, what: str) -> NDArray:
        """Observations [A, ...]; NaN for who is not there."""
        seen = np.full((len(self.agents), *self.spaces[0][0].shape), np.nan)
        for index, agent in enumerate(self.agents):
            if observation.get(agent) is not None:
                array = np.asarray(observation[agent])
                seen[index] = self.require_space(array[None], index, what)[0]
        return seen


def _limit(env: Any) -> int | None:
    """Steps until truncation, as the environment states them."""
    inner = env.unwrapped
    if hasattr(inner, "time_limit"):
        return inner.time_limit
    return getattr(getattr(env, "spec", None), "max_episode_steps", None)
