"""The toy game of `faulty` under JAX: N fights as brax has them, one as JaxMARL has it."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import State
from faulty import LIMIT
from flax import struct
from gymnasium.spaces import Box


class ToyState(struct.PyTreeNode):
    """One fight under JAX, of any number of agents."""

    place: jax.Array  # [A]
    drift: jax.Array  # [A]
    clock: jax.Array  # []


def begin(key: jax.Array, fault: str, agents: int) -> ToyState:
    if fault == "seeds alike":
        key = jax.random.key(0)
    place, drift = jax.random.uniform(key, (2, agents), minval=-1.0)
    return ToyState(0.4 * place, 0.02 * drift, jnp.zeros((), jnp.int32))


def walk(state: ToyState, action: jax.Array, fault: str) -> tuple[ToyState, jax.Array, jax.Array]:
    """(state, decided [], ran out of time []) after one step."""
    place, clock = state.place + 0.15 * action + state.drift, state.clock + 1
    if fault == "impure":
        place = place + np.random.default_rng().uniform(0.0, 0.01)  # the point of the test
    if fault == "weak type":
        clock = clock.astype(jnp.float32)
    decided = jnp.any(jnp.abs(place) > 1.0)
    limit = LIMIT + 3 if fault == "late" else LIMIT
    return ToyState(place, state.drift, clock), decided, (clock >= limit) & ~decided


class ToyBrax:
    """N fights of one agent, as brax's wrapped environments."""

    observation_size, action_size, time_limit = 2, 1, LIMIT

    def __init__(self, fault: str = ""):
        self.fault = fault

    @property
    def unwrapped(self) -> "ToyBrax":
        return self

    def reset(self, rng: jax.Array) -> State:
        first = jax.vmap(lambda key: begin(key, self.fault, 1))(rng)
        seen, zero = self._seen(first), jnp.zeros(len(rng))
        info = {
            "key": rng, "first": first, "final_observation": seen, "truncation": zero,
        }  # fmt: skip
        if self.fault == "no final":
            del info["final_observation"]
        return State(first, seen, zero, zero, {}, info)  # pyright: ignore[reportArgumentType]

    def step(self, state: State, action: jax.Array) -> State:
        old = state.pipeline_state
        after, decided, late = jax.vmap(lambda one, act: walk(one, act, self.fault))(old, action)
        over = decided | late
        if self.fault == "neighbours":
            after = after.replace(place=after.place + 0.01 * jnp.sum(action))
        if self.fault == "lost transition":
            stop = jnp.any(over) & ~over
            after = jax.tree.map(lambda a, b: self._where(stop, b, a), after, old)
        final = self._seen(after)
        keys = jax.vmap(jax.random.split)(state.info["key"])
        new = jax.vmap(lambda key: begin(key, self.fault, 1))(keys[:, 1])
        new = state.info["first"] if self.fault == "start repeats" else new
        after = jax.tree.map(lambda a, b: self._where(over, a, b), new, after)
        told = late & (self.fault != "truncation told as termination")
        info = state.info | {"key": keys[:, 0], "truncation": told.astype(jnp.float32)}
        if self.fault != "no final":
            shown = {"final lost": self._seen(after), "final stale": state.obs}
            info["final_observation"] = shown.get(self.fault, final)
        done = over if self.fault == "done as bool" else over.astype(jnp.float32)
        reward = 1.0 - jnp.abs(after.place[:, 0])
        return replace(state, pipeline_state=after, obs=self._seen(after), reward=reward, done=done, info=info)  # fmt: skip  # pyright: ignore

    def _where(self, condition: jax.Array, new: jax.Array, old: jax.Array) -> jax.Array:
        return jnp.where(condition.reshape(-1, *[1] * (new.ndim - 1)), new, old)

    def _seen(self, state: ToyState) -> jax.Array:
        seen = jnp.concatenate([state.place, state.drift], axis=1)
        return seen.at[:, 1].set(jnp.inf) if self.fault == "outside" else seen


class ToyMarl:
    """One fight of two agents, as JaxMARL's environments; decided when either is beyond its line."""

    agents, max_steps = ("a", "b"), LIMIT

    def __init__(self, fault: str = ""):
        self.fault = fault
        self.spaces = (Box(-9.0, 9.0, (2,), np.float32), Box(-1.0, 1.0, (1,), np.float32))

    def observation_space(self, agent: str) -> Box:
        return self.spaces[0]

    def action_space(self, agent: str) -> Box:
        return self.spaces[1]

    def reset(self, key: jax.Array) -> tuple[dict, ToyState]:
        state = begin(key, self.fault, 2)
        return self._seen(state), state

    def step_env(self, key: jax.Array, state: ToyState, actions: dict) -> tuple:
        pushed = jnp.stack([actions[one][0] for one in self.agents])
        after, decided, late = walk(state, pushed, self.fault)
        reward = {one: 1.0 - jnp.abs(after.place[i]) for i, one in enumerate(self.agents)}
        over = decided | late
        if self.fault == "reward as int":
            reward = {one: jnp.round(value).astype(jnp.int32) for one, value in reward.items()}
        infos = {} if self.fault == "nothing told" else {"final_observation": self._seen(after)}
        if self.fault == "final stale":
            infos["final_observation"] = self._seen(state)
        if self.fault != "truncation told as termination":
            infos["truncated"] = late
        dones = dict.fromkeys((*self.agents, "__all__"), over)
        if self.fault == "dones as float":
            dones = {name: done.astype(jnp.float32) for name, done in dones.items()}
        if self.fault == "own done lost":
            dones["b"] = jnp.zeros_like(over)
        return self._seen(after), after, reward, dones, infos

    def step(self, key: jax.Array, state: ToyState, actions: dict) -> tuple:
        seen, after, reward, dones, infos = self.step_env(key, state, actions)
        key = jax.random.key(3) if self.fault == "start repeats" else key
        again, new = self.reset(key)
        over = dones["__all__"].astype(bool)
        pick = lambda a, b: jnp.where(over, a, b)
        if self.fault == "final lost":
            infos["final_observation"] = jax.tree.map(pick, again, seen)
        return jax.tree.map(pick, again, seen), jax.tree.map(pick, new, after), reward, dones, infos

    def _seen(self, state: ToyState) -> dict:
        shift = 20.0 if self.fault == "outside" else 0.0
        seen = jnp.stack([state.place, state.drift + shift], axis=1)
        seen = seen.astype(jnp.float16) if self.fault == "dtype" else seen
        return {one: seen[i] for i, one in enumerate(self.agents)}


BRAX = {
    "seeds alike": "seeds-alike", "start repeats": "start-repeats", "late": "time-limit",
    "neighbours": "neighbours", "lost transition": "lost-transition",
    "truncation told as termination": "truncation", "done as bool": "dtype",
    "no final": "final-observation", "final lost": "final-observation",
    "final stale": "final-observation", "outside": "space", "impure": "impure",
    "weak type": "state-type",
}  # fmt: skip
JAXMARL = {
    "seeds alike": "seeds-alike", "start repeats": "start-repeats", "late": "time-limit",
    "truncation told as termination": "truncation", "dones as float": "dtype",
    "reward as int": "dtype", "own done lost": "dones", "nothing told": "final-observation",
    "final lost": "final-observation", "final stale": "final-observation", "outside": "space",
    "dtype": "dtype", "impure": "impure", "weak type": "state-type",
}  # fmt: skip
