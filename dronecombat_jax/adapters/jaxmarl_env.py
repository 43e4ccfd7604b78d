"""Both sides of one fight in the shape of JaxMARL's `MultiAgentEnv`, for `jax.vmap` and `jax.jit`.

    env = CombatMultiAgentEnv(Combat(load_config("duel")))
    observations, state = jax.vmap(env.reset)(keys)
    observations, state, rewards, dones, infos = jax.vmap(env.step)(keys, state, actions)

Where JaxMARL is installed this is one of its environments; where it is not, the same methods stand
without it. JaxMARL's `step` has no place for a time-out, and writes the next fight's observation over
the last one: both are in `infos`. What does not live here: the game (`combat`).
"""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from dronecombat_jax.adapters.one_side import choose_one, time_limit
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.sides import drone_names
from dronecombat_jax.errors import UserError
from dronecombat_jax.types import ACTION_SIZE, SIDES, EnvState

ALL = "__all__"
Observations = dict[str, jax.Array]


class OwnBox(NamedTuple):
    """JaxMARL's `Box` where JaxMARL is not installed."""

    low: float
    high: float
    shape: tuple[int, ...]
    dtype: Any = jnp.float32

    def sample(self, key: jax.Array) -> jax.Array:
        """A random value, each alike likely; the bounds must be finite."""
        return jax.random.uniform(key, self.shape, self.dtype, self.low, self.high)

    def contains(self, value: jax.Array) -> jax.Array:
        """Whether all of `value` lies between the bounds, [] bool."""
        return jnp.all((value >= self.low) & (value <= self.high))


Base: Any = object
Box: Any = OwnBox
with suppress(ImportError):  # also where JaxMARL is installed and what it needs is not
    from jaxmarl.environments.multi_agent_env import (  # pyright: ignore[reportMissingImports]
        MultiAgentEnv as Base,
    )
    from jaxmarl.environments.spaces import Box  # pyright: ignore[reportMissingImports]


class CombatMultiAgentEnv(Base):
    """One fight; agents are `defender` and `attacker`, in `solo` the attacker alone.

    Infos: `final_observation`, by agent, after the step and before any new beginning; `truncated`,
    by agent, time ran out on an undecided fight; `cause`, a `Cause`, NONE while the fight goes on.
    `dones` say both kinds of end, for all agents together.
    """

    def __init__(self, combat: Combat, end_infos: bool = True):
        """`end_infos` False leaves infos empty, for programs that reshape all of them to [N]."""
        sides = combat.sides
        self._drones = {
            name: drone
            for drone, (name, side) in enumerate(zip(drone_names(sides), sides, strict=True))
            if combat.game.flies[side]
        }
        names = list(self._drones)
        if Base is not object:
            super().__init__(num_agents=len(names))
        self.combat, self.end_infos = combat, end_infos
        self.agents, self.num_agents = names, len(names)
        seen = Box(-jnp.inf, jnp.inf, (combat.observation.size,), jnp.float32)
        self.observation_spaces = dict.fromkeys(names, seen)
        self.action_spaces = dict.fromkeys(names, Box(-1.0, 1.0, (ACTION_SIZE,), jnp.float32))

    @property
    def name(self) -> str:
        return "dronecombat_jax"

    @property
    def agent_classes(self) -> dict[str, list[str]]:
        """Each side is a class of its own."""
        sides = self.combat.sides
        classes: dict[str, list[str]] = {}
        for agent, drone in self._drones.items():
            classes.setdefault(SIDES[sides[drone]], []).append(agent)
        return classes

    @property
    def time_limit(self) -> int | None:
        """Control steps until an undecided fight is truncated; None where the time-out decides it."""
        return time_limit(self.combat)

    def observation_space(self, agent: str) -> Any:
        """The space of an agent's observations. Raises UserError for an agent that is none."""
        return self._of(self.observation_spaces, agent)

    def action_space(self, agent: str) -> Any:
        """The space of an agent's actions. Raises UserError for an agent that is none."""
        return self._of(self.action_spaces, agent)

    def reset(self, key: jax.Array) -> tuple[Observations, EnvState]:
        """A fight about to begin: observations [35] by agent, and its state."""
        state = self.combat.reset(key)
        return self.get_obs(state), state

    def step(
        self,
        key: jax.Array,
        state: EnvState,
        actions: Mapping[str, jax.Array],
        reset_state: EnvState | None = None,
    ) -> tuple[Observations, EnvState, dict, dict, dict]:
        """One control step; where it ends the fight, `reset_state`, or a random fight by `key`,
        follows.
        """
        seen, after, rewards, dones, infos = self.step_env(key, state, actions)
        begun = self.combat.reset(key) if reset_state is None else reset_state
        over = dones[ALL]
        following = choose_one(over, begun, after)
        observations = choose_one(over, self.get_obs(begun), seen)
        return observations, following, rewards, dones, infos

    def step_env(
        self, key: jax.Array, state: EnvState, actions: Mapping[str, jax.Array]
    ) -> tuple[Observations, EnvState, dict, dict, dict]:
        """One control step with each agent's action [4]; does not begin anew, and nothing is random."""
        given = [jnp.zeros(ACTION_SIZE)] * len(self.combat.sides)  # 0 for one that is absent
        for agent, drone in self._drones.items():
            given[drone] = jnp.asarray(actions[agent])
        after, output = self.combat.step(state, jnp.stack(given))
        seen = self._by_agent(output.observation)
        over = output.terminated | output.truncated
        infos = {}
        if self.end_infos:
            infos = {
                "final_observation": seen,
                "truncated": dict.fromkeys(self.agents, output.truncated),
                "cause": output.cause,
            }
        dones = dict.fromkeys([*self.agents, ALL], over)
        return seen, after, self._by_agent(output.reward), dones, infos

    def get_obs(self, state: EnvState) -> Observations:
        """Observations [35] by agent."""
        return self._by_agent(self.combat.observe(state))

    def get_avail_actions(self, state: EnvState) -> dict[str, jax.Array]:
        """All of the action is available, [4] ones."""
        return {agent: jnp.ones(ACTION_SIZE, bool) for agent in self.agents}

    def _by_agent(self, rows: jax.Array) -> dict[str, jax.Array]:
        return {agent: rows[drone] for agent, drone in self._drones.items()}

    def _of(self, spaces: dict[str, Any], agent: str) -> Any:
        if agent not in spaces:
            raise UserError(f"agent {one_line(str(agent))}: there are {', '.join(self.agents)}")
        return spaces[agent]
