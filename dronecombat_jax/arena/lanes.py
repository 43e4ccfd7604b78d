"""The program of a round robin: one batch of lanes, each with a fight of its own, flown for a few
control steps.

Lanes of one policy sit together in blocks, so that a side's policies fly as one batched product
over small blocks. Every shape is static, and neither the number of entrants nor that of episodes is
one of them: a program is compiled once for two networks. What does not live here: who flies where
(`schedule`), the whole grid (`tournament`).
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from dronecombat_jax.arena.match import (
    AnyPilot,
    Remembered,
    advance,
    as_pilot,
    mate_key,
    no_result,
)
from dronecombat_jax.arena.players import Kind, names_flown
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.scripted import build_pilot, one_per_fight
from dronecombat_jax.combat.sensors import view_of
from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.config.sides import mates
from dronecombat_jax.learn.mates import of_mate
from dronecombat_jax.learn.memory import with_recall
from dronecombat_jax.learn.rollout import policy_step, recalled
from dronecombat_jax.types import (
    ACTION_SIZE,
    ATTACKER,
    DEFENDER,
    NUM_SIDES,
    Cause,
    EnvState,
    FightResult,
    Policy,
    SidePolicy,
)

STARTS, NOISE = 0, 1  # what the tournament's seed is used for


class Layout(NamedTuple):
    """Static shapes of one batch.

    TRAP: another number of lanes makes XLA round MJX's last bits differently, so it is one for a
    kind of device; more lanes in the air are more batches. Nothing else in here, and no place in a
    batch, can change an outcome.
    """

    lanes: int
    block: int  # lanes that share one policy's product
    blocks: int  # on each side; more than lanes / block, for those that are not full
    steps: int = 16  # control steps of a call


class Side(NamedTuple):
    """Who flies one side in a call."""

    policies: SidePolicy | None  # leaves [blocks, ...]
    rows: jax.Array  # [blocks, block] int32, the lane on each seat; an empty seat repeats lane 0
    # [L] int32, the seat of each lane, counted through all blocks; 0 for a lane without one
    seat: jax.Array
    # [L] int32, the scripted pilot, numbered as in `names_flown`; -1: a policy flies
    pilot: jax.Array


class Drone(NamedTuple):
    """Which drone a pilot flies."""

    role: int
    place: int  # among all drones of the fight
    number: int  # in its team


class Orders(NamedTuple):
    """What the lanes are to do in a call."""

    begin: jax.Array  # [L] bool: drop what was there and start anew
    start: EnvState  # leaves [L, ...], used where a fight begins
    words: jax.Array  # [L, 4] uint32, `players.content_words` of defender and attacker
    episode: jax.Array  # [L] int32
    seed: jax.Array  # [] uint32, of the tournament


class Lanes(NamedTuple):
    """A batch between two calls."""

    state: EnvState  # leaves [L, ...]
    result: FightResult  # leaves [L, ...]; a lane whose fight has a cause stands still


Act = Callable[[EnvState, jax.Array, jax.Array], Remembered]
Fly = Callable[[Lanes, Orders, tuple[Side, Side]], Lanes]


def build_fly(combat: Combat, kinds: tuple[Kind, Kind], layout: Layout, stochastic: bool) -> Fly:
    """The function that flies a batch for `layout.steps` control steps; `kinds` by role. To be
    jitted.
    """

    def fly(lanes: Lanes, orders: Orders, sides: tuple[Side, Side]) -> Lanes:
        pick = lambda new, old: jnp.where(orders.begin.reshape(-1, *[1] * (new.ndim - 1)), new, old)
        start = with_recall(orders.start, _memory(kinds))
        lanes = jax.tree.map(pick, Lanes(start, no_result(start)), lanes)
        keys = (
            jax.vmap(partial(fight_key, orders.seed))(orders.words, orders.episode)
            if stochastic
            else None
        )
        defender, attacker = (
            _team(combat, kinds[role], sides[role], role, keys) for role in (DEFENDER, ATTACKER)
        )
        unused = jax.random.key(0)  # these pilots have the fights' own keys

        def step(lanes: Lanes, _: jax.Array | None) -> tuple[Lanes, None]:
            state, result, _actions = advance(
                combat, defender, attacker, lanes.state, lanes.result, unused
            )
            return Lanes(state, result), None

        return jax.lax.scan(step, lanes, None, length=layout.steps)[0]

    return fly


def idle_lanes(combat: Combat, kinds: tuple[Kind, Kind], layout: Layout) -> Lanes:
    """A batch in which nobody has begun to fight; NumPy leaves."""
    begin = lambda key: with_recall(combat.reset(key), _memory(kinds))
    fight = jax.eval_shape(begin, jax.random.key(0))
    state = jax.tree.map(lambda leaf: np.zeros((layout.lanes, *leaf.shape), leaf.dtype), fight)
    result = jax.tree.map(
        lambda leaf: np.zeros(leaf.shape, leaf.dtype), jax.eval_shape(no_result, state)
    )
    return Lanes(state, result._replace(cause=np.full_like(result.cause, Cause.TIMEOUT)))


def start_states(combat: Combat, seed: jax.Array | int, episodes: int) -> EnvState:
    """The start states [E, ...] of a tournament, the same in every cell; that of episode e depends
    on `seed` and e alone.
    """
    key = jax.random.fold_in(jax.random.key(seed), STARTS)
    return jax.vmap(lambda episode: combat.reset(jax.random.fold_in(key, episode)))(
        jnp.arange(episodes)
    )


def fight_key(seed: jax.Array, words: jax.Array, episode: jax.Array) -> jax.Array:
    """The key of one stochastic fight: of the seed, `words` [4] of both players, and the episode,
    and of nothing else.

    As the key of `match.fight` for this fight alone it gives the same random numbers.
    """
    key = jax.random.fold_in(jax.random.key(seed), NOISE)
    for number in (*words, episode):
        key = jax.random.fold_in(key, number)
    return key


def _memory(kinds: tuple[Kind, Kind]) -> int:
    """Numbers that a lane keeps of its fight for each drone."""
    return max(kind.memory for kind in kinds)


def _team(
    combat: Combat, kind: Kind, side: Side, role: int, keys: jax.Array | None
) -> list[AnyPilot]:
    """The pilots of a side's drones, who fly the lane's policy or scripted pilot."""
    return [
        _pilot(combat, kind, side, Drone(role, drone, number), keys)
        for number, drone in enumerate(mates(combat.sides, role))
    ]


def _pilot(
    combat: Combat, kind: Kind, side: Side, drone: Drone, keys: jax.Array | None
) -> AnyPilot:
    policies = None
    if side.policies is not None:
        policies = _policies(kind, of_mate(side.policies, drone.number), side, drone, keys)
    view = view_of(combat.config, kind.observation)
    role = drone.role
    names = names_flown(kind, role)
    pilots = (
        [build_pilot(name, combat.config, combat.scene, role, drone.place) for name in names]
        if kind.scripted
        else []
    )
    scripted = side.pilot >= 0

    def act(state: EnvState, observation: jax.Array, key: jax.Array) -> Remembered:
        follow = lambda: one_per_fight(pilots, jnp.maximum(side.pilot, 0))(state, observation, key)
        if policies is None:
            return follow(), recalled(state, drone.place)
        action, recall = policies(state, view(state, observation), key)
        if not pilots:
            return action, recall
        other: jax.Array = jax.lax.cond(jnp.any(scripted), follow, lambda: jnp.zeros_like(action))
        return jnp.where(scripted[:, None], other, action), recall

    return as_pilot(act, kind.memory)


def _policies(
    kind: Kind, policies: Policy, side: Side, drone: Drone, keys: jax.Array | None
) -> Act:
    """Every lane's policy, flown block by block; `keys` [L] make the random actions."""
    learn = LearnConfig(normalize_observations=kind.normalize)

    def act(state: EnvState, observation: jax.Array, _: jax.Array) -> Remembered:
        seen = observation[side.rows, drone.place]
        before = jax.tree.map(lambda leaf: leaf[side.rows], recalled(state, drone.place))
        flying = jax.vmap(partial(policy_step, learn))(policies, seen, before)
        # [blocks, block, ...] -> [L, ...]
        of_lanes = lambda leaf: leaf.reshape(-1, leaf.shape[-1])[side.seat]
        mean, recall = jax.tree.map(of_lanes, flying)
        if keys is None:
            return mean, recall
        spread = jnp.repeat(jnp.exp(policies.log_std), side.rows.shape[1], axis=0)[side.seat]
        return mean + spread * jax.vmap(partial(_noise, drone))(keys, state.clock), recall

    return act


def _noise(drone: Drone, key: jax.Array, clock: jax.Array) -> jax.Array:
    """The random numbers [4] of `match.fight` of one fight alone for the policy of `drone` in the
    step after `clock`.
    """
    key = jax.random.split(jax.random.fold_in(key, clock), NUM_SIDES)[drone.role]
    return jax.random.normal(mate_key(key, drone.number), (1, ACTION_SIZE))[0]
