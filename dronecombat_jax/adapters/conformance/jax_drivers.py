"""How the checker drives pure environments of JAX: brax's and JaxMARL's. N fights are one program.

Beside the rules of `rules` they are tried for purity, and for a state that keeps its type.
"""

import re
from abc import abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.adapters.conformance.trace import Driver, Look
from dronecombat_jax.errors import UserError

FINAL = ("final_observation", "final_obs", "terminal_observation")  # names in infos
TRUNCATED = ("truncated", "truncation")


class Unbounded(NamedTuple):
    """The space of brax's observations and actions, which brax does not describe."""

    shape: tuple[int, ...]
    low: float = -np.inf
    high: float = np.inf
    dtype: Any = np.float32


def of_brax(env: Any, number: int) -> Driver | None:
    """A driver for a brax environment of N fights; None for anything else."""
    if not all(hasattr(env, name) for name in ("observation_size", "action_size", "unwrapped")):
        return None
    return BraxDriver(env, number)


def of_jaxmarl(env: Any, number: int) -> Driver | None:
    """A driver for N of a JaxMARL environment; None for anything else."""
    if not all(hasattr(env, name) for name in ("step_env", "agents", "observation_space")):
        return None
    return JaxMarlDriver(env, number)


class JaxDriver(Driver):
    """What both have in common: jitted programs, and a state that goes in and comes out."""

    reseeds = False  # a key is always given

    def __init__(self, env: Any, number: int):
        super().__init__(env)
        self.number = number
        self._state: Any = None
        self._last: tuple = ()

    def call(self, program: Callable, *arguments: Any) -> Any:
        """The program's result; its arguments are kept, to trace it again at the end."""
        self._last = arguments
        return program(*arguments)

    def keep(self, state: Any) -> None:
        """Take the new state; note it where its type is not that of the old one."""
        if self._state is not None and _described(state) != _described(self._state):
            self.note(
                "state-type",
                "step's state has other shapes, dtypes or weak types than it was given",
            )
        self._state = state

    def finish(self) -> None:
        """Note a step that is another program when it is traced again: it reads or writes what is
        not in its state.
        """
        if self._last and self._traced() != self._traced():
            self.note("impure", "step is another program each time that it is traced")

    def _traced(self) -> tuple[str, list[bytes]]:
        """The program of a step as text, and its constants."""
        traced = jax.make_jaxpr(lambda *arguments: self.stepped(*arguments))(*self._last)
        text = re.sub(r"0x[0-9a-f]+", "", str(traced.jaxpr))
        return text, [np.asarray(constant).tobytes() for constant in traced.consts]

    @abstractmethod
    def stepped(self, *arguments: Any) -> Any:
        """One step of all fights, to be traced."""


class BraxDriver(JaxDriver):
    """A brax environment whose `reset` takes N keys."""

    agents = ("the agent",)

    def __init__(self, env: Any, number: int):
        super().__init__(env, number)
        size = env.observation_size
        if not isinstance(size, int):
            raise UserError("check: brax observations of several parts are not supported")
        self.spaces = [(Unbounded((size,)), Unbounded((env.action_size,), -1.0, 1.0))]
        stated = getattr(env, "time_limit", 0)
        self.time_limit = stated if stated != 0 else getattr(env, "episode_length", None)
        self._reset, self._step = jax.jit(env.reset), jax.jit(self.stepped)
        shape = jax.eval_shape(env.reset, self._keys(0)).obs.shape
        if shape != (number, size):
            raise UserError(
                f"check: {number} keys give observations {shape}; wrap the environment, so that they "
                f"are ({number}, {size}) and fights begin anew (brax_env.wrap)"
            )

    def stepped(self, *arguments: Any) -> Any:
        return self.env.step(*arguments)

    def _keys(self, seed: int) -> Any:
        return jax.random.split(jax.random.PRNGKey(seed), self.number)

    def reset(self, seed: int | None) -> NDArray:
        self._state = None
        self.keep(self._reset(self._keys(seed or 0)))
        return np.array(self.require_space(self._state.obs, 0, "observation"))[:, None]

    def step(self, actions: NDArray) -> Look:
        shape = (self.number,)
        self.keep(self.call(self._step, self._state, actions[:, 0]))
        state = self._state
        observation = self.require_space(state.obs, 0, "observation")[:, None]
        done = np.asarray(state.done)
        if done.shape != shape or not np.issubdtype(done.dtype, np.floating):
            self.note("dtype", f"done is {done.dtype} {done.shape}, not a float {shape}")
        over = np.broadcast_to(done.astype(bool), shape)
        named = next((name for name in FINAL if name in state.info), None)
        final = observation if named is None else _of_agent(self, state.info[named])
        truncated = np.zeros(shape, bool)
        for name in ("truncation", "time_out"):
            if name in state.info:
                truncated |= np.asarray(state.info[name]).astype(bool)
        reward = self.require_reward(state.reward, shape)[:, None]
        shown = over & (named is not None)
        return Look(
            observation, final, shown, reward, over & ~truncated, over & truncated,
            np.ones(shape, bool), over,
        )  # fmt: skip


class JaxMarlDriver(JaxDriver):
    """N of a JaxMARL environment, which begin anew in the step that ends them."""

    def __init__(self, env: Any, number: int):
        super().__init__(env, number)
        self.agents = tuple(env.agents)
        self.spaces = [
            (env.observation_space(agent), env.action_space(agent)) for agent in self.agents
        ]
        if len({space.shape for space, _ in self.spaces}) > 1:
            raise UserError("check: agents with different observation spaces are not supported")
        stated = getattr(env, "time_limit", 0)
        self.time_limit = stated if stated != 0 else getattr(env, "max_steps", None)
        self._reset = jax.jit(jax.vmap(env.reset))
        self._step = jax.jit(self.stepped)
        self._key = jax.random.key(0)

    def stepped(self, *arguments: Any) -> Any:
        return jax.vmap(self.env.step)(*arguments)

    def reset(self, seed: int | None) -> NDArray:
        self._state, self._key = None, jax.random.key(seed or 0)
        self._key, key = jax.random.split(self._key)
        observation, state = self._reset(jax.random.split(key, self.number))
        self.keep(state)
        return self._gather(observation, "observation")

    def step(self, actions: NDArray) -> Look:
        shape, width = (self.number,), (self.number, len(self.agents))
        self._key, key = jax.random.split(self._key)
        given = {agent: actions[:, index] for index, agent in enumerate(self.agents)}
        keys = jax.random.split(key, self.number)
        seen, state, rewards, dones, infos = self.call(self._step, keys, self._state, given)
        self.keep(state)
        for name, by_agent in (("observations", seen), ("rewards", rewards), ("dones", dones)):
            if not set(self.agents) <= set(by_agent):
                raise UserError(f"check: {name} lack an agent; JaxMARL's name all of them")
        observation = self._gather(seen, "observation")
        over = self.require_flags(dones["__all__"], "dones['__all__']", shape)
        each = [
            self.require_flags(dones[agent], f"dones['{agent}']", shape) for agent in self.agents
        ]
        if np.any(over & ~np.all(each, axis=0)):
            self.note("dones", "dones['__all__'] is set where an agent's own is not")
        columns = [self.require_reward(rewards[agent], shape) for agent in self.agents]
        named = next((name for name in FINAL if name in infos), None)
        final = observation if named is None else self._final(infos[named])
        truncated = self._truncated(infos)
        reward = np.stack(columns, axis=1).reshape(width)
        return Look(
            observation, final, over & (named is not None), reward, over & ~truncated,
            over & truncated, np.ones(shape, bool), over,
        )  # fmt: skip

    def _truncated(self, infos: Any) -> NDArray[np.bool_]:
        """Whether each fight was truncated; where infos do not tell, none was."""
        for name in TRUNCATED:
            if name in infos:
                flags = infos[name]
                flags = flags[self.agents[0]] if isinstance(flags, dict) else flags
                array = np.asarray(flags).astype(bool)
                return np.asarray(array.reshape(len(array), -1).any(axis=-1))
        return np.zeros(self.number, bool)

    def _final(self, info: Any) -> NDArray:
        if isinstance(info, dict):
            return self._gather(info, "final observation")
        array = np.asarray(info)  # [N, A, ...]
        columns = dict(zip(self.agents, np.moveaxis(array, 1, 0), strict=True))
        return self._gather(columns, "final observation")

    def _gather(self, seen: Any, what: str) -> NDArray:
        """Observations [N, A, ...] out of a dict of agents."""
        each = [
            self.require_space(seen[agent], index, what) for index, agent in enumerate(self.agents)
        ]
        return np.stack(each, axis=1)


def _of_agent(driver: Driver, seen: Any) -> NDArray:
    return driver.require_space(seen, 0, "final observation")[:, None]


def _described(tree: Any) -> Any:
    """Structure, shapes, dtypes and weak types of a pytree."""
    leaves, structure = jax.tree.flatten(tree)
    types = [(leaf.shape, str(leaf.dtype), bool(getattr(leaf, "weak_type", 0))) for leaf in leaves]
    return structure, types
