"""One role of the fight as a brax environment: brax.training's PPO and SAC learn it against a
frozen opponent.

    env = CombatEnv(combat, ATTACKER, build_pilot("hover_guard", config, combat.scene))
    mend_brax()
    ppo.train(env, episode_length=env.episode_steps, wrap_env_fn=wrap, ...)

In here: the view and the wrapper that `train` needs. Not in here: training, and the game itself
(`combat`). `wrap` stands in for brax's own wrapper, which starts every fight of an environment from
the same state.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import Env, State, Wrapper
from brax.envs.wrappers.training import EpisodeWrapper, VmapWrapper

from dronecombat_jax.adapters.one_side import (
    WINS,
    all_actions,
    begin,
    earned,
    refuse_wrong_number,
    role_of,
    seen,
    time_limit,
)
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.combat.scripted import Pilot
from dronecombat_jax.config.sides import mates
from dronecombat_jax.errors import UserError
from dronecombat_jax.types import (
    ACTION_SIZE,
    EnvState,
    Outcome,
    StepOutput,
)


class CombatEnv(Env):
    """One fight, flown by a learner as `role` and by `opponent` in the other place; `reset` and
    `step` are pure.

    `done` is 1 at every end; `info["time_out"]` is 1 where time ran out on an undecided fight, as
    brax's `bootstrap_on_timeout` reads it. `info["final_observation"]` [35] is the observation
    after the step, before any reset. `metrics` `win`, `draw` (a tie) and `loss` are 1 at the step that ends
    a fight so. `info["key"]` is there because brax's `step` is given no key.
    """

    def __init__(
        self, combat: Combat, role: int, opponent: Pilot | None = None, exploring: bool = False
    ):
        """`opponent` flies the other role; None in the scenario `solo`, where the attacker is
        alone. `exploring`: fights begin as in training, with up to `train.start_speed`; give
        `train` an `eval_env` without it.

        Raises UserError for a role that is none, and for an opponent too many or too few.
        """
        role = role_of(role)
        refuse_wrong_number(combat, role, int(opponent is not None))
        self.combat, self.role, self._opponent = combat, role, opponent
        self._exploring, self._drones = exploring, len(mates(combat.sides, role))
        self._outcomes = np.asarray(outcome_table(combat.config.game))

    @property
    def observation_size(self) -> int:
        return self._drones * self.combat.observation.size

    @property
    def action_size(self) -> int:
        return self._drones * ACTION_SIZE

    @property
    def backend(self) -> str:
        return "mjx"

    @property
    def episode_steps(self) -> int:
        """Control steps until time-out: the `episode_length` for brax."""
        return self.combat.config.game.episode_steps

    @property
    def time_limit(self) -> int | None:
        """Control steps until an undecided fight is truncated; None where the time-out decides it."""
        return time_limit(self.combat)

    def reset(self, rng: jax.Array) -> State:
        """A fight about to start, at random by `rng`: a key, new style or old."""
        start, key = jax.random.split(_typed(rng))
        fight = self.begin(start)
        observation = self.observe(fight)
        zero = jnp.zeros(())
        return State(
            pipeline_state=fight,  # pyright: ignore[reportArgumentType] (brax means any pytree)
            obs=observation,
            reward=zero,
            done=zero,
            metrics={"win": zero, "draw": zero, "loss": zero},
            info={
                "key": jax.random.key_data(key),
                "time_out": zero,
                "final_observation": observation,
            },
        )

    def step(self, state: State, action: jax.Array) -> State:
        """Fly one control step with the learner's `action` [4], or [4 M]; the environment clips it.
        Does not reset.
        """
        key, opponent_key = jax.random.split(_typed(state.info["key"]))
        fight, output = self.combat.step(
            _fight(state), self._both(_fight(state), action, opponent_key)
        )
        observation = seen(self.combat, self.role, output.observation)
        info = {
            "key": jax.random.key_data(key),
            "time_out": output.truncated.astype(jnp.float32),
            "final_observation": observation,
        }
        return replace(
            state,
            pipeline_state=fight,  # pyright: ignore[reportArgumentType]
            obs=observation,
            reward=earned(self.combat, self.role, output.reward),
            done=(output.terminated | output.truncated).astype(jnp.float32),
            metrics=state.metrics | self._outcome(output),
            info=state.info | info,
        )

    def begin(self, key: jax.Array) -> EnvState:
        """A fight about to start, at random by `key`."""
        return begin(self.combat, key, self._exploring)

    def observe(self, fight: EnvState) -> jax.Array:
        """What the learner sees of a fight, [35]; of a team of M drones [35 M]."""
        return seen(self.combat, self.role, self.combat.observe(fight))

    def _both(self, fight: EnvState, action: jax.Array, key: jax.Array) -> jax.Array:
        """Both actions [A, 4]. A pilot flies a batch of fights, here of one."""
        if self._opponent is None:
            other = jnp.zeros(ACTION_SIZE)
        else:
            alone = jax.tree.map(lambda leaf: leaf[None], fight)
            other = self._opponent(alone, self.combat.observe(fight)[None], key)[0]
        return all_actions(self.role, action, other)

    def _outcome(self, output: StepOutput) -> dict[str, jax.Array]:
        ended = output.terminated | output.truncated
        outcome = jnp.asarray(self._outcomes)[output.cause]
        named = {"win": WINS[self.role], "draw": Outcome.DRAW, "loss": WINS[1 - self.role]}
        return {
            name: (ended & (outcome == which)).astype(jnp.float32) for name, which in named.items()
        }


class FreshStarts(Wrapper):
    """Fights side by side, each end followed by a new random start; time-outs are truncations.

    `game.random_clock` has no effect: brax evaluates through this wrapper, too, and wants whole
    fights.
    """

    def __init__(self, env: Env, mask_time_outs: bool = True):
        super().__init__(env)
        self._fights: CombatEnv = env.unwrapped  # pyright: ignore[reportAttributeAccessIssue] (`wrap` sees to it)
        self._mask_time_outs = mask_time_outs

    def reset(self, rng: jax.Array) -> State:
        """A start for each of the keys `rng`: new style [N] or old [N, 2].

        Brax's wrappers take its last axis for that of an old key.
        """
        return self.env.reset(_raw(rng))

    def step(self, state: State, action: jax.Array) -> State:
        """One control step of every fight; `obs` is the next fight's first where one has ended."""
        state.info["steps"] = jnp.where(state.done, 0.0, state.info["steps"])
        state = self.env.step(replace(state, done=jnp.zeros_like(state.done)), action)
        keys = jax.vmap(jax.random.split)(_typed(state.info["key"]))
        ended = state.done.astype(bool)
        choose = lambda new, old: jnp.where(ended.reshape(-1, *[1] * (new.ndim - 1)), new, old)
        fight = jax.tree.map(choose, jax.vmap(self._fights.begin)(keys[:, 1]), _fight(state))
        info = state.info | {"key": jax.random.key_data(keys[:, 0])}
        if self._mask_time_outs:
            info["truncation"] = jnp.maximum(info["truncation"], info["time_out"])
        observation = jax.vmap(self._fights.observe)(fight)
        return replace(state, pipeline_state=fight, obs=observation, info=info)  # pyright: ignore[reportArgumentType]


def wrap(
    env: Env,
    episode_length: int,
    action_repeat: int = 1,
    randomization_fn: None = None,
    mask_time_outs: bool = True,
) -> Wrapper:
    """The `wrap_env_fn` for brax's `ppo.train` and `sac.train`: a batch of fights with fresh
    starts.

    A truncated step is left out of PPO's and SAC's losses (`info["truncation"]`). For PPO's
    `bootstrap_on_timeout` pass `functools.partial(wrap, mask_time_outs=False)`. An `episode_length`
    below the game's own truncates earlier; above, nothing changes. Raises UserError for another
    environment, repeated actions and randomised models.
    """
    if not isinstance(env.unwrapped, CombatEnv):
        raise UserError(f"wrap is for CombatEnv, not for {type(env.unwrapped).__name__}")
    if action_repeat != 1:
        raise UserError(
            f"action_repeat = {action_repeat}: a fight may end in between; raise sim.substeps instead"
        )
    if randomization_fn is not None:
        raise UserError("randomization_fn: the fights of one Combat share one model")
    return FreshStarts(
        EpisodeWrapper(VmapWrapper(env), episode_length, action_repeat), mask_time_outs
    )


def mend_brax() -> None:
    """Give jax back `device_put_replicated`, which brax 0.14.2's `train` functions call.

    jax 0.9 warns of it and jax 0.10 has withdrawn it. Does nothing where it stands. The replacement
    is that of jax's migration guide.
    """
    if "device_put_replicated" in vars(jax):  # what is only deprecated does not stand there
        return

    def device_put_replicated(tree, devices):
        mesh = jax.sharding.Mesh(np.asarray(devices), ("devices",))
        along = jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec("devices"))
        stack = lambda leaf: jnp.broadcast_to(leaf, (len(devices), *jnp.shape(leaf)))
        return jax.device_put(jax.tree.map(stack, tree), along)

    setattr(jax, "device_put_replicated", device_put_replicated)  # noqa: B010 (a stub says that it is not there)


def _typed(key: jax.Array) -> jax.Array:
    """The same key or keys in the new style; brax carries the old one, and its `train` copies no
    other.
    """
    return key if jnp.issubdtype(key.dtype, jax.dtypes.prng_key) else jax.random.wrap_key_data(key)


def _raw(key: jax.Array) -> jax.Array:
    """The same key or keys in the old style."""
    return jax.random.key_data(key) if jnp.issubdtype(key.dtype, jax.dtypes.prng_key) else key


def _fight(state: State) -> EnvState:
    fight = state.pipeline_state
    assert isinstance(fight, EnvState)
    return fight
