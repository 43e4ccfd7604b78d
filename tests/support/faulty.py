"""A toy game for the checker's tests, with one fault planted: for Gymnasium and PettingZoo.

A fight: a place on a line walks by the action and by a drift of its own, drawn at its start; beyond
+-1 it is decided, after LIMIT steps truncated. What an agent sees is the place and the drift.
"""

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from pettingzoo import ParallelEnv

LIMIT = 12


class ToyVector(VectorEnv):
    """N fights under NumPy."""

    time_limit = LIMIT

    def __init__(self, fault: str = "", mode: AutoresetMode = AutoresetMode.SAME_STEP):
        self.fault, self.mode, self.num_envs = fault, mode, 6
        self.metadata = {} if fault == "no mode" else {"autoreset_mode": mode}
        self.single_observation_space = Box(-9.0, 9.0, (2,), np.float32)
        self.single_action_space = Box(-1.0, 1.0, (1,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, 6)
        self.action_space = batch_space(self.single_action_space, 6)
        self.random = [np.random.default_rng() for _ in range(6)]
        self.place, self.drift = np.zeros(6), np.zeros(6)
        self.clock, self.over = np.zeros(6, int), np.zeros(6, bool)
        self.buffer = np.zeros((6, 2), np.float32)
        self.seed: int | None = None

    def reset(self, *, seed=None, options=None) -> tuple[np.ndarray, dict]:
        mask = np.ones(6, bool) if options is None else options["reset_mask"]
        if self.fault == "reset repeats":
            seed = self.seed if seed is None else seed
        if seed is not None:
            self.seed = seed
            self._seed(seed)
        self._begin(mask)
        return self._seen(), {}

    def _seed(self, seed: int) -> None:
        each = [(seed, index) for index in range(6)]
        if self.fault == "seed ignored":
            return
        if self.fault == "seeds alike":
            each = [(0, index) for index in range(6)]
        if self.fault == "fights alike":
            each = [(seed, 0)] * 6
        self.random = [np.random.default_rng(one) for one in each]

    def _begin(self, mask: np.ndarray) -> None:
        for index in np.flatnonzero(mask):
            if self.fault == "start repeats" and self.clock[index]:
                self.place[index], self.drift[index] = self.first[:, index]
            else:
                self.place[index] = self.random[index].uniform(-0.4, 0.4)
                self.drift[index] = self.random[index].uniform(-0.02, 0.02)
        if not self.clock.any() or mask.all():
            self.first = np.stack([self.place, self.drift])
        self.clock[mask], self.over[mask] = 0, False

    def step(self, actions: np.ndarray) -> tuple:
        idle = self.over & (self.mode is AutoresetMode.NEXT_STEP)
        before = self._seen().copy()
        go = ~idle
        if self.fault == "lost transition" and (idle.any() or self._any_end(actions)):
            go &= idle | self._ends(actions)
        self.place[go] += 0.15 * actions[go, 0] + self.drift[go]
        if self.fault == "neighbours":
            self.place[go] += 0.01 * np.sum(actions[go, 0])
        self.clock[go] += 1
        if self.fault == "action written":
            actions[:] = 0.0
        terminated = go & (np.abs(self.place) > 1.0)
        late = LIMIT + 3 if self.fault == "late" else LIMIT - 2 if self.fault == "early" else LIMIT
        truncated = go & (self.clock >= late) & ~terminated
        reward = np.where(go, 1.0 - np.abs(self.place), 0.0).astype(np.float32)
        return self._report(before, idle, terminated, truncated, reward)

    def _report(self, before, idle, terminated, truncated, reward) -> tuple:
        over, infos = terminated | truncated, {}
        final = self._seen().copy()
        if self.mode is AutoresetMode.NEXT_STEP:
            if self.fault == "reward at reset":
                reward = np.where(idle, 5.0, reward).astype(np.float32)
            self._begin(over if self.fault == "final lost" else idle)
        elif self.mode is AutoresetMode.SAME_STEP and over.any():
            self._begin(over)
            shown = {"final lost": self._seen(), "final stale": before}.get(self.fault, final)
            if self.fault != "no final":
                infos["final_obs"] = np.full(6, None, dtype=object)
                for index in np.flatnonzero(over):
                    infos["final_obs"][index] = shown[index].copy()
                infos["_final_obs"] = ~over if self.fault == "mask" else over.copy()
        self.over = over
        if self.fault == "truncation told as termination":
            terminated, truncated = terminated | truncated, np.zeros(6, bool)
        if self.fault == "flags as int":
            terminated = terminated.astype(int)
        if self.fault == "reward as int":
            reward = np.round(reward).astype(int)
        return self._seen(), reward, terminated, truncated, infos

    def _ends(self, actions: np.ndarray) -> np.ndarray:
        there = self.place + 0.15 * actions[:, 0] + self.drift
        return (np.abs(there) > 1.0) | (self.clock + 1 >= LIMIT)

    def _any_end(self, actions: np.ndarray) -> bool:
        return self.mode is AutoresetMode.SAME_STEP and bool(self._ends(actions).any())

    def _seen(self) -> np.ndarray:
        seen = np.stack([self.place, self.drift], axis=1).astype(np.float32)
        if self.fault == "outside":
            seen[:, 1] += 10.0
        if self.fault == "dtype":
            return seen.astype(np.float64)
        if self.fault == "shape":
            return seen[:, :1]
        if self.fault == "memory":
            self.buffer[:] = seen
            return self.buffer
        return seen


GYMNASIUM = {
    "no mode": "autoreset-mode", "seed ignored": "seed", "seeds alike": "seeds-alike",
    "fights alike": "fights-alike", "reset repeats": "reset-repeats",
    "start repeats": "start-repeats", "lost transition": "lost-transition",
    "neighbours": "neighbours", "action written": "action", "late": "time-limit",
    "early": "time-limit", "final lost": "final-observation",
    "final stale": "final-observation", "no final": "final-observation", "mask": "mask",
    "truncation told as termination": "truncation", "flags as int": "dtype",
    "reward as int": "dtype", "outside": "space", "dtype": "dtype", "shape": "shape",
    "memory": "memory",
}  # fmt: skip
NEXT_STEP = {
    "reward at reset": "after-the-end", "final lost": "final-observation",
    "lost transition": "lost-transition", "truncation told as termination": "truncation",
    "neighbours": "neighbours",
}  # fmt: skip


class ToyParallel(ParallelEnv):
    """One fight of two agents, each on a line of its own; one that is beyond it leaves."""

    metadata = {"name": "toy"}  # noqa: RUF012 (as PettingZoo has it)
    possible_agents = ["a", "b"]  # noqa: RUF012
    time_limit = LIMIT

    def __init__(self, fault: str = ""):
        self.fault = fault
        self.spaces = (Box(-9.0, 9.0, (2,), np.float32), Box(-1.0, 1.0, (1,), np.float32))
        self.random = np.random.default_rng()
        self.agents = []

    def observation_space(self, agent: str) -> Box:
        return self.spaces[0]

    def action_space(self, agent: str) -> Box:
        return self.spaces[1]

    def reset(self, seed=None, options=None) -> tuple[dict, dict]:
        if seed is not None and self.fault != "seed ignored":
            self.random = np.random.default_rng(0 if self.fault == "seeds alike" else seed)
        if self.fault == "start repeats":
            self.random = np.random.default_rng(seed or 0)
        self.agents, self.clock = list(self.possible_agents), 0
        self.place = dict(zip(self.agents, self.random.uniform(-0.4, 0.4, 2), strict=True))
        self.drift = dict(zip(self.agents, self.random.uniform(-0.02, 0.02, 2), strict=True))
        return self._seen(self.agents), {one: {} for one in self.agents}

    def step(self, actions: dict) -> tuple[dict, dict, dict, dict, dict]:
        acted, self.clock = list(self.agents), self.clock + 1
        for one in acted:
            self.place[one] += 0.15 * float(actions[one][0]) + self.drift[one]
        ended = {one: abs(self.place[one]) > 1.0 for one in acted}
        late = self.clock >= (LIMIT + 3 if self.fault == "late" else LIMIT)
        truncated = {one: late and not ended[one] for one in acted}
        if self.fault == "truncation told as termination":
            ended, truncated = (
                {one: ended[one] or late for one in acted},
                dict.fromkeys(acted, False),
            )
        if self.fault == "flags of JAX":
            ended = {one: np.int32(flag) for one, flag in ended.items()}
        reward = {one: 1.0 - abs(self.place[one]) for one in acted}
        infos = {one: {} for one in acted}
        seen = self._seen(acted)
        over = [one for one in acted if ended[one] or truncated[one]]
        if self.fault != "revived":
            self.agents = [one for one in acted if one not in over]
        if self.fault == "reward after the end":
            reward = {one: reward.get(one, -1.0) for one in self.possible_agents}
        if self.fault == "no final":
            seen = {one: seen[one] for one in acted if one not in over}
        if self.fault == "info lacks":
            infos.popitem()
        return seen, reward, ended, truncated, infos

    def _seen(self, agents: list[str]) -> dict:
        dtype = np.float64 if self.fault == "dtype" else np.float32
        shift = 20.0 if self.fault == "outside" else 0.0
        return {one: np.array([self.place[one], self.drift[one] + shift], dtype) for one in agents}


PETTINGZOO = {
    "seed ignored": "seed", "seeds alike": "seeds-alike", "start repeats": "start-repeats",
    "late": "time-limit", "truncation told as termination": "truncation", "flags of JAX": "dtype",
    "revived": "revived", "reward after the end": "after-the-end", "info lacks": "keys",
    "no final": "final-observation", "dtype": "dtype", "outside": "space",
}  # fmt: skip
