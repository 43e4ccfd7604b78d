"""One side of the fight as Gymnasium environments: many fights in one call, or one fight.

    combat = Combat(load_config("duel"))
    fights = CombatVectorEnv(combat, "attacker", "pilots:sippo-defender", num_envs=256)
    fight = CombatEnv(combat, "defender", ["scripted:dash", "scripted:weave"])

The learner flies all drones of its side: of a team of M, observations are [35 M] and actions [4 M],
one drone's after the other's, and the reward is the mean of the team's. All fights of a vector
environment are flown in one jitted call, and its results are copied to NumPy once a step. Fight i of
seed s is the same however many fights there are, and `CombatEnv` flies fight 0. Infos have `cause` (a `Cause`), `outcome` (1 won, 0 tied, -1 lost) and `is_success` of the fights
that ended. What does not live here: the game (`combat`), starts and opponents (`one_side`).
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.adapters.extras import missing

try:
    import gymnasium
    from gymnasium.spaces import Box
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError:
    raise missing("gymnasium", "gymnasium") from None

from dronecombat_jax.adapters.frames import RENDER_MODES, Frames, require_mode
from dronecombat_jax.adapters.one_side import Bout, role_of, scores, seed_words, time_limit
from dronecombat_jax.adapters.opponents import Opponents, pilots_of
from dronecombat_jax.adapters.side_programs import Flown, programs
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.sides import mates
from dronecombat_jax.errors import UserError
from dronecombat_jax.types import ACTION_SIZE, Cause

MAX_SEED = 2**32  # of the environment's own generator, where no seed is given


class CombatVectorEnv(VectorEnv):
    """N fights of a learner that flies `role`, each against an opponent of its own.

    `autoreset_mode`: SAME_STEP begins a fight anew in the step that ends it, and keeps the end in
    `infos["final_obs"]` and `infos["final_info"]`; NEXT_STEP begins it in the following step, whose
    action is ignored and whose reward is 0; DISABLED leaves it to `reset` with
    `options={"reset_mask": [N] bool}`.
    """

    def __init__(
        self,
        combat: Combat,
        role: int | str,
        opponents: Opponents = None,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        exploring: bool = False,
    ):
        """`opponents`: as of `opponents.pilots_of`; None in `solo`. `exploring`: fights begin as in
        training, with up to `train.start_speed`. Raises UserError for what cannot be.
        """
        if isinstance(num_envs, bool) or not isinstance(num_envs, int) or num_envs < 1:
            raise UserError(f"num_envs = {num_envs}: a whole number from 1 on is allowed")
        self.combat, self.role, self.num_envs = combat, role_of(role), num_envs
        self.autoreset_mode = _mode_of(autoreset_mode)
        self.metadata = {"autoreset_mode": self.autoreset_mode, "render_modes": []}
        self.single_observation_space, self.single_action_space = spaces_of(combat, self.role)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        pilots = pilots_of(combat, self.role, opponents)
        self._programs = programs(combat, self.role, pilots, self.autoreset_mode.name, exploring)
        self._scores = scores(combat, self.role)
        self._bout: Bout | None = None
        self._over = np.zeros(num_envs, bool)

    @property
    def time_limit(self) -> int | None:
        """Control steps until an undecided fight is truncated; None where the time-out decides it."""
        return time_limit(self.combat)

    @property
    def bout(self) -> Bout:
        """The fights as they stand, leaves [N, ...]. Raises UserError before the first `reset`."""
        if self._bout is None:
            raise UserError("no fight has begun: call reset() first")
        return self._bout

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin all fights, or those of `options["reset_mask"]` [N] bool; observations [N, 35].

        `seed`: one for all, or one for each fight, which then is fight 0 of its seed; without it the
        fights are the next ones. Raises UserError for a mask or a list of another size.
        """
        if isinstance(seed, int):
            seed_words(seed)
            super().reset(seed=seed)
        mask = self._mask(options)
        if seed is None and self._bout is None:
            seed = int(self.np_random.integers(MAX_SEED))
        keys = self._seeded(seed)
        if self._bout is None:
            self._bout, observation = self._programs.begin(keys)
        else:
            self._bout, observation = self._programs.renew(self._bout, keys, mask)
        self._over = self._over & ~mask
        return np.array(observation), {}

    def step(
        self, actions: Any
    ) -> tuple[
        NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_], dict
    ]:
        """One control step of every fight with `actions` [N, 4], which are clipped to [-1, 1].

        Raises UserError for actions of another shape, and under DISABLED for a fight that is over.
        """
        shape = self.action_space.shape
        given = np.asarray(actions, np.float32)
        if given.shape != shape:
            raise UserError(f"actions have the shape {given.shape}: {shape} is needed")
        if self.autoreset_mode is AutoresetMode.DISABLED and self._over.any():
            over = np.flatnonzero(self._over)[:5].tolist()
            raise UserError(f"fights {over} are over: reset them with options['reset_mask']")
        self._bout, flown = self._programs.step(self.bout, given, self._over)
        flown = Flown(*(np.array(leaf) for leaf in flown))
        self._over = flown.terminated | flown.truncated
        return (
            flown.observation,
            flown.reward,
            flown.terminated,
            flown.truncated,
            self._infos(flown),
        )

    def _infos(self, flown: Flown) -> dict[str, Any]:
        """Infos of a step; empty where no fight ended."""
        if not self._over.any():
            return {}
        infos = ends(self._scores, flown.cause, self._over)
        if self.autoreset_mode is not AutoresetMode.SAME_STEP:
            return infos
        final = np.full(self.num_envs, None, dtype=object)
        for index in np.flatnonzero(self._over):
            final[index] = flown.final_observation[index].copy()
        return {
            "final_obs": final,
            "_final_obs": self._over.copy(),
            "final_info": infos,
            "_final_info": self._over.copy(),
        }

    def _mask(self, options: dict[str, Any] | None) -> NDArray[np.bool_]:
        if not options or "reset_mask" not in options:
            return np.ones(self.num_envs, bool)
        mask = np.asarray(options["reset_mask"])
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise UserError(
                f"options['reset_mask'] is {mask.dtype} {mask.shape}: bool ({self.num_envs},) with a "
                "True in it is needed"
            )
        if self._bout is None and not mask.all():
            raise UserError(
                "options['reset_mask'] before the first reset(): begin all fights first"
            )
        return mask

    def _seeded(self, seed: int | list[int | None] | None) -> jax.Array:
        """The key of each fight's next beginning, [N]."""
        if seed is None:
            return self.bout.key
        if isinstance(seed, int | np.integer):
            return self._programs.keys(seed_words(seed), self.num_envs)
        if len(seed) != self.num_envs:
            raise UserError(f"{len(seed)} seeds for {self.num_envs} fights: one for each is needed")
        if self._bout is None and None in seed:
            raise UserError("seed = [.., None, ..]: a fight that never began needs a seed")
        keys = [
            self.bout.key[index] if word is None else self._programs.keys(seed_words(word), 1)[0]
            for index, word in enumerate(seed)
        ]
        return jnp.stack(keys)


class CombatEnv(gymnasium.Env):
    """One fight of a learner that flies `role`, against an opponent drawn for each fight.

    `render_mode`: "rgb_array" gives a picture, uint8 [540, 960, 3], "ansi" a line, "human" prints it.
    """

    def __init__(
        self,
        combat: Combat,
        role: int | str,
        opponents: Opponents = None,
        render_mode: str | None = None,
    ):
        """`opponents`: as of `opponents.pilots_of`; None in `solo`. Raises UserError for what cannot
        be.
        """
        self._fights = CombatVectorEnv(combat, role, opponents, 1, AutoresetMode.DISABLED)
        self.metadata = {
            "render_modes": list(RENDER_MODES),
            "render_fps": round(1.0 / combat.config.control_dt),
        }
        self.render_mode = require_mode(render_mode)
        self.combat, self.role = combat, self._fights.role
        self.observation_space, self.action_space = spaces_of(combat, self.role)
        self._frames = Frames(combat)

    @property
    def time_limit(self) -> int | None:
        """Control steps until an undecided fight is truncated; None where the time-out decides it."""
        return self._fights.time_limit

    @property
    def bout(self) -> Bout:
        """The fight as it stands. Raises UserError before the first `reset`."""
        return jax.tree.map(lambda leaf: leaf[0], self._fights.bout)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin a fight; observation [35]. Without `seed` it is the next fight of the last seed."""
        if seed is not None:
            seed_words(seed)
            super().reset(seed=seed)
        if seed is None and self._fights._bout is None:
            seed = int(self.np_random.integers(MAX_SEED))
        observation, _ = self._fights.reset(seed=seed)
        return observation[0], {}

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """One control step with `action` [4], clipped to [-1, 1]. Raises UserError after the end."""
        given = np.asarray(action, np.float32)
        if given.shape != self.action_space.shape:
            shape = self.action_space.shape
            raise UserError(f"the action has the shape {given.shape}: {shape} is needed")
        if self._fights._over[0]:
            raise UserError("the fight is over: call reset()")
        observation, reward, terminated, truncated, infos = self._fights.step(given[None])
        info = {key: array[0].item() for key, array in infos.items() if not key.startswith("_")}
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), info

    def render(self) -> Any:
        """The fight as it stands, as `render_mode` says; None without one."""
        return self._frames.show(self.render_mode, self.bout.fight)

    def close(self) -> None:
        """Give the pictures' resources back."""
        self._frames.close()


def spaces_of(combat: Combat, role: int) -> tuple[Box, Box]:
    """The spaces of a side's M drones: an observation [35 M], not bounded, an action [4 M] in [-1, 1]."""
    drones = len(mates(combat.sides, role))
    return (
        Box(-np.inf, np.inf, (drones * combat.observation.size,), np.float32),
        Box(-1.0, 1.0, (drones * ACTION_SIZE,), np.float32),
    )


def ends(scores: NDArray, cause: NDArray, over: NDArray[np.bool_]) -> dict[str, NDArray]:
    """Infos of the fights that are `over` [N], each with its mask, as Gymnasium lays them out."""
    outcome = np.where(over, scores[cause], 0)
    infos = {
        "cause": np.where(over, cause, int(Cause.NONE)),
        "outcome": outcome,
        "is_success": outcome > 0,
    }
    return infos | {f"_{name}": over.copy() for name in infos}


def _mode_of(mode: AutoresetMode | str) -> AutoresetMode:
    try:
        return mode if isinstance(mode, AutoresetMode) else AutoresetMode[str(mode).upper()]
    except KeyError:
        names = ", ".join(member.name for member in AutoresetMode)
        raise UserError(f"autoreset_mode = {one_line(str(mode))}: {names} are allowed") from None
