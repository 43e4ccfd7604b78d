"""Batched fights between two pilots or teams of them, without learning: who wins, how, how fast.

A pilot is a pure function `(state [E, ...], observation [E, A, 35], key) -> action [E, 4]` that
flies one drone; trained policies and scripted pilots are the same to a match. A side of several
drones is flown by as many pilots, in their order. One that remembers its fight is `Remembering`.
Many policies against many: `tournament`.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.scripted import Pilot, build_pilot
from dronecombat_jax.combat.sensors import View, as_shown, view_of
from dronecombat_jax.config.fields import Config, LearnConfig
from dronecombat_jax.config.sides import mates
from dronecombat_jax.learn.mates import of_drone
from dronecombat_jax.learn.memory import memory_size, with_recall
from dronecombat_jax.learn.rollout import policy_step, recalled
from dronecombat_jax.types import (
    ATTACKER,
    DEFENDER,
    Cause,
    EnvState,
    FightRecord,
    FightResult,
    Policy,
    SidePolicy,
    Trajectory,
)

Remembered = tuple[jax.Array, jax.Array | None]  # actions [E, 4], what is remembered [E, M]


@dataclass(frozen=True)
class Remembering:
    """A pilot that remembers its fight: what it returns besides its action, at least `size`
    numbers [E, M], is in the fights' `recall` when it is asked again.
    """

    size: int
    act: Callable[[EnvState, jax.Array, jax.Array], Remembered]


AnyPilot = Pilot | Remembering
Team = AnyPilot | Sequence[AnyPilot]  # of one side, a pilot for each of its drones


def policy_pilot(
    learn: LearnConfig,
    policy: Policy,
    drone: int,
    stochastic: bool = False,
    view: View = as_shown,
) -> AnyPilot:
    """Fly `policy` as `drone`, which in a duel is the role: its mean action or, `stochastic`, a
    random action. `view`: of `view_of`.

    Its log-std is taken as it is: `policies.file.as_flown` puts it into its bounds.
    """

    size = memory_size(policy)

    def act(state: EnvState, observation: jax.Array, key: jax.Array) -> Remembered:
        before = recalled(state, drone) if size else None
        mean, recall = policy_step(learn, policy, view(state, observation)[:, drone], before)
        if not stochastic:
            return mean, recall
        return mean + jnp.exp(policy.log_std) * jax.random.normal(key, mean.shape), recall

    return as_pilot(act, size)


def as_pilot(act: Callable[..., Remembered], size: int) -> AnyPilot:
    """`act` as a pilot that remembers `size` numbers: 0, and it is a plain one."""
    return Remembering(size, act) if size else lambda *given: act(*given)[0]


def pilots_of(team: Team) -> Sequence[AnyPilot]:
    """The pilots of a team, one for each of its drones."""
    return [team] if isinstance(team, Remembering) or callable(team) else team


def ready(start: EnvState, *teams: Team) -> EnvState:
    """Fights about to start [E, ...], with room for what their pilots will remember."""
    pilots = [pilot for team in teams for pilot in pilots_of(team)]
    sizes = [pilot.size for pilot in pilots if isinstance(pilot, Remembering)]
    return with_recall(start, max(sizes, default=0))


def policy_team(
    config: Config,
    learn: LearnConfig,
    policy: SidePolicy,
    role: int,
    stochastic: bool = False,
    observation: str = "",
) -> Sequence[AnyPilot]:
    """`policy` at the controls of every drone of the side `role`; `observation`: what it sees, where
    that is not the game's own.
    """
    sides, view = config.game.sides, view_of(config, observation)
    return [
        policy_pilot(learn, of_drone(policy, sides, drone), drone, stochastic, view)
        for drone in mates(sides, role)
    ]


def scripted_team(combat: Combat, name: str, role: int) -> Sequence[Pilot]:
    """The scripted pilot `name` at the controls of every drone of the side `role`. UserError for an
    unknown one.
    """
    return [
        build_pilot(name, combat.config, combat.scene, role, drone)
        for drone in mates(combat.sides, role)
    ]


def start_fights(combat: Combat, key: jax.Array, num_fights: int) -> EnvState:
    """The start states [E, ...] of a match; the same key gives the same fights to every pair."""
    return jax.vmap(combat.spawn)(combat.start_numbers(key, (num_fights,)))


def fight(
    combat: Combat, defender: Team, attacker: Team, start: EnvState, key: jax.Array
) -> FightResult:
    """Fight all of `start` [E, ...] to the end; stops when the last one has ended."""

    def running(carry: tuple) -> jax.Array:
        return jnp.any(carry[1].cause == Cause.NONE)

    def step_on(carry: tuple) -> tuple:
        state, result, step = carry
        state, result, _ = advance(
            combat, defender, attacker, state, result, jax.random.fold_in(key, step)
        )
        return state, result, step + 1

    begun = ready(start, defender, attacker)
    carry = (begun, no_result(start), jnp.zeros((), jnp.int32))
    return jax.lax.while_loop(running, step_on, carry)[1]


def record(
    combat: Combat, defender: Team, attacker: Team, start: EnvState, key: jax.Array
) -> FightRecord:
    """Like `fight`, keeping every step: `episode_steps` of them."""

    def step_on(carry: tuple, step: jax.Array) -> tuple:
        state, result = carry
        state, result, action = advance(
            combat, defender, attacker, state, result, jax.random.fold_in(key, step)
        )
        fallen = (None, None) if start.struck is None else (state.down, state.struck)
        return (state, result), (state.qpos, state.qvel, jnp.clip(action, -1.0, 1.0), *fallen)

    steps = jnp.arange(combat.config.game.episode_steps)
    carry = ready(start, defender, attacker), no_result(start)
    (_, result), kept = jax.lax.scan(step_on, carry, steps)
    qpos, qvel, action, down, struck = kept
    return FightRecord(qpos, qvel, action, start, result, down, struck)


def advance(
    combat: Combat,
    defender: Team,
    attacker: Team,
    state: EnvState,
    result: FightResult,
    key: jax.Array,
) -> tuple[EnvState, FightResult, jax.Array]:
    """Fly one control step of every fight `state` [E, ...] whose `result` [E, ...] has no cause
    yet; the rest stand still.

    Also returns the actions [E, A, 4] that the pilots gave. A fight's outcome does not depend on
    the others beside it.
    """
    observation = jax.vmap(combat.observe)(state)
    keys = jax.random.split(key)
    pilots = [
        (pilot, mate_key(keys[role], number))
        for role, side in ((DEFENDER, defender), (ATTACKER, attacker))
        for number, pilot in enumerate(pilots_of(side))
    ]
    acts = [
        _act(pilot, drone, state, observation, key) for drone, (pilot, key) in enumerate(pilots)
    ]
    action, recall = jax.tree.map(lambda *leaves: jnp.stack(leaves, axis=1), *acts)
    after, output = jax.vmap(combat.step)(state, action)
    after = after.replace(recall=recall)
    on = result.cause == Cause.NONE
    keep = lambda new, old: jnp.where(on.reshape(-1, *[1] * (new.ndim - 1)), new, old)
    now = FightResult(output.cause, result.steps + 1, after.crashed & ~combat.absent)
    return jax.tree.map(keep, after, state), jax.tree.map(keep, now, result), action


def _act(
    pilot: AnyPilot, drone: int, state: EnvState, observation: jax.Array, key: jax.Array
) -> Remembered:
    """What a pilot does with its drone, and what is remembered after it."""
    if isinstance(pilot, Remembering):
        return pilot.act(state, observation, key)
    return pilot(state, observation, key), recalled(state, drone)


def mate_key(key: jax.Array, number: int) -> jax.Array:
    """The key of a team's drone `number` for a step; the first has the side's own."""
    return jax.random.fold_in(key, number) if number else key


def no_result(start: EnvState) -> FightResult:
    """The result [E, ...] of fights that have not ended."""
    return FightResult(
        jnp.zeros_like(start.clock), jnp.zeros_like(start.clock), jnp.zeros_like(start.down)
    )


def trajectory(combat: Combat, fights: FightRecord, index: int) -> Trajectory:
    """One fight of a record, cut at its end, its start state first."""
    steps = int(fights.result.steps[index])
    first = lambda start, path: np.concatenate(
        [np.asarray(start)[index][None], np.asarray(path)[:steps, index]]
    )
    action = np.asarray(fights.action)[:steps, index]
    team = fights.down is not None
    return Trajectory(
        time=np.arange(steps + 1) * combat.config.control_dt,
        qpos=first(fights.start.qpos, fights.qpos),
        qvel=first(fights.start.qvel, fights.qvel),
        action=np.concatenate([action, action[-1:]]),
        target=np.asarray(fights.start.target)[index],
        cause=int(fights.result.cause[index]),
        control_dt=combat.config.control_dt,
        sides=combat.sides,
        down=first(fights.start.down, fights.down) if team else None,
        struck=first(fights.start.struck, fights.struck) if team else None,
        drawn=drawn_numbers(combat.config, fights.start, index),
    )


def drawn_numbers(config: Config, start: EnvState, index: int | slice) -> dict[str, Any]:
    """What was drawn for the drones of a fight, or of those of a slice, by setting of `randomise`:
    numbers over the nominal ones [..., A]; empty where nothing was.
    """
    if start.craft is None or start.craft.drawn is None:
        return {}
    drawn, varied = start.craft.drawn, asdict(config.randomise).items()
    return {name: np.asarray(getattr(drawn, name), float)[index] for name, share in varied if share}
