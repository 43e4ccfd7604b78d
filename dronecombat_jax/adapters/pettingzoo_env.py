"""Both sides of one fight as a PettingZoo `ParallelEnv`.

    env = CombatParallelEnv(Combat(load_config("duel")))
    observations, infos = env.reset(seed=0)

Both agents are there until the fight ends, also a drone that is down: the fight can still be won or
lost for it. Its info then says that its action had no effect. In `solo` there is the attacker alone.
What does not live here: the game (`combat`), many fights at once (`gymnasium_env`, `jaxmarl_env`).
"""

import functools
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.adapters.extras import missing

try:
    from gymnasium.spaces import Box
    from pettingzoo import ParallelEnv
except ImportError:
    raise missing("pettingzoo", "pettingzoo") from None

from dronecombat_jax.adapters.frames import RENDER_MODES, Frames, require_mode
from dronecombat_jax.adapters.one_side import scores, seed_words, time_limit
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.sides import drone_names
from dronecombat_jax.errors import UserError
from dronecombat_jax.types import ACTION_SIZE, Cause, EnvState

STATE_SIZE = 14  # of each drone; 4 more are of the fight


class CombatParallelEnv(ParallelEnv):
    """One fight; agents are `defender` and `attacker`, in a team `defender1`, `defender2` and so on.

    `state()` is qpos (7 each), qvel (6 each), the target's place (3), the share of the time that is
    over and whether each drone is down: float32 [32] for two. Agents of a team stay until the fight
    is over, as drones that are down. Infos: `active`, whether the action had an effect,
    and at the end `cause` (a `Cause`) and `outcome` (1 won, 0 tied, -1 lost).
    """

    def __init__(self, combat: Combat, render_mode: str | None = None):
        """`render_mode`: rgb_array (uint8 [540, 960, 3]), ansi (a line), human (prints it) or None."""
        self.combat, self.render_mode = combat, require_mode(render_mode)
        self.metadata = {
            "name": "dronecombat_jax",
            "render_modes": list(RENDER_MODES),
            "render_fps": round(1.0 / combat.config.control_dt),
            "is_parallelizable": True,
        }
        sides = combat.sides
        self._drones = {
            name: drone
            for drone, (name, side) in enumerate(zip(drone_names(sides), sides, strict=True))
            if combat.game.flies[side]
        }
        self.possible_agents = list(self._drones)
        self.agents: list[str] = []
        size = combat.observation.size
        self.observation_spaces = {
            agent: Box(-np.inf, np.inf, (size,), np.float32) for agent in self.possible_agents
        }
        self.action_spaces = {
            agent: Box(-1.0, 1.0, (ACTION_SIZE,), np.float32) for agent in self.possible_agents
        }
        self.state_space = Box(-np.inf, np.inf, (STATE_SIZE * len(sides) + 4,), np.float32)
        self.state_spaces = dict.fromkeys(self.possible_agents, self.state_space)
        self._scores = [scores(combat, side) for side in sides]
        self._begin, self._step = _programs(combat)
        self._frames = Frames(combat)
        self._words: NDArray[np.uint32] | None = None
        self._episode = 0
        self._fight: EnvState | None = None

    @property
    def time_limit(self) -> int | None:
        """Control steps until an undecided fight is truncated; None where the time-out decides it."""
        return time_limit(self.combat)

    @property
    def fight(self) -> EnvState:
        """The fight as it stands. Raises UserError before the first `reset`."""
        if self._fight is None:
            raise UserError("no fight has begun: call reset() first")
        return self._fight

    def observation_space(self, agent: str) -> Box:
        """The space of an agent's observations, the same object each time."""
        return self._of(self.observation_spaces, agent)

    def action_space(self, agent: str) -> Box:
        """The space of an agent's actions, the same object each time."""
        return self._of(self.action_spaces, agent)

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[np.float32]], dict[str, dict[str, Any]]]:
        """Begin a fight: observations [35] and infos by agent. Without `seed` it is the next fight
        of the last seed. No options are known.
        """
        if seed is not None or self._words is None:
            number = int(np.random.default_rng().integers(2**63)) if seed is None else seed
            self._words, self._episode = seed_words(number), 0
        self._fight, observation = self._begin(self._words, np.uint32(self._episode))
        self._episode += 1
        self.agents = list(self.possible_agents)
        return self._by_agent(np.array(observation)), {agent: {} for agent in self.agents}

    def step(self, actions: Mapping[str, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """One control step with each agent's action [4], clipped to [-1, 1].

        Raises UserError after the end, for an agent too few or too many and for another shape.
        """
        pair = self._pair(actions)
        self._fight, leaves = self._step(self._fight, pair)
        observation, reward, terminated, truncated, cause, active = map(np.array, leaves)
        acted = self.agents
        infos: dict[str, dict] = {
            agent: {"active": bool(active[self._drones[agent]])} for agent in acted
        }
        if terminated or truncated:
            self.agents = []
            for agent in acted:
                outcome = int(self._scores[self._drones[agent]][cause])
                infos[agent] |= {"cause": int(Cause(cause)), "outcome": outcome}
        return (
            self._by_agent(observation),
            {agent: float(reward[self._drones[agent]]) for agent in acted},
            dict.fromkeys(acted, bool(terminated)),
            dict.fromkeys(acted, bool(truncated)),
            infos,
        )

    def state(self) -> NDArray[np.float32]:
        """The whole fight, float32 [14 A + 4], of which the world frame's observation is a part."""
        fight, steps = self.fight, self.combat.config.game.episode_steps
        parts = (fight.qpos, fight.qvel, fight.target, [fight.clock / steps], fight.down)
        return np.concatenate([np.asarray(part, np.float32) for part in parts])

    def render(self) -> Any:
        """The fight as it stands, as `render_mode` says; None without one."""
        return self._frames.show(self.render_mode, self.fight)

    def close(self) -> None:
        """Give the pictures' resources back."""
        self._frames.close()

    def _pair(self, actions: Mapping[str, Any]) -> NDArray[np.float32]:
        """All drones' actions [A, 4]; 0 for one that is absent."""
        if not self.agents:
            raise UserError("the fight is over, or has not begun: call reset()")
        if set(actions) != set(self.agents):
            given = ", ".join(map(str, actions)) or "none"
            raise UserError(
                f"actions of {one_line(given)}: those of {', '.join(self.agents)} are needed"
            )
        pair = np.zeros((len(self.combat.sides), ACTION_SIZE), np.float32)
        for agent in self.agents:
            action = np.asarray(actions[agent], np.float32)
            if action.shape != (ACTION_SIZE,):
                raise UserError(
                    f"the {agent}'s action has the shape {action.shape}, not ({ACTION_SIZE},)"
                )
            pair[self._drones[agent]] = action
        return pair

    def _by_agent(self, observation: NDArray) -> dict[str, NDArray[np.float32]]:
        """Rows of `observation` [A, 35], each a copy of its own."""
        return {agent: observation[self._drones[agent]].copy() for agent in self.possible_agents}

    def _of(self, spaces: Mapping[str, Any], agent: str) -> Box:
        if agent not in spaces:
            names = ", ".join(self.possible_agents)
            raise UserError(f"agent {one_line(str(agent))}: there are {names}")
        return spaces[agent]


@functools.lru_cache(maxsize=32)
def _programs(combat: Combat) -> tuple[Callable, Callable]:
    """Jitted: the beginning of a seed's n-th fight, and one step."""

    def begin(words: jax.Array, episode: jax.Array) -> tuple[EnvState, jax.Array]:
        fight = combat.reset(jax.random.fold_in(jax.random.wrap_key_data(words), episode))
        return fight, combat.observe(fight)

    def step(fight: EnvState, action: jax.Array) -> tuple[EnvState, tuple[jax.Array, ...]]:
        after, output = combat.step(fight, action)
        return after, (
            output.observation, output.reward, output.terminated, output.truncated, output.cause,
            jnp.asarray(output.active),
        )  # fmt: skip

    return jax.jit(begin), jax.jit(step)
