"""The table of opponents, flown and counted: who acts in a side's place, and how fights against each went.

The table itself is read from the settings (`config.opponents`). Rows of environments keep their
places in all chunks; rows of chunks are drawn at a chunk's start, one for all environments
(`pool.choose`). Scripted pilots and frozen policies fly their mean action, as in evaluations; past
players draw theirs, as they did when they were live. What does not live here: the pool of past
players (`pool`).
"""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.scripted import Pilot, build_pilot
from dronecombat_jax.combat.sensors import view_of
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.opponents import NOBODY as ALONE
from dronecombat_jax.config.opponents import Places, Row, live_part, places, table
from dronecombat_jax.learn.algorithms import ALL, Learners, live_policy
from dronecombat_jax.learn.mates import Both, of_drone
from dronecombat_jax.learn.rollout import (
    Acts,
    Policies,
    Seat,
    draw_action,
    policy_step,
    recalled,
)
from dronecombat_jax.selfplay.pool import FIXED, NOBODY, chunk_rows, member, met, players
from dronecombat_jax.types import (
    ACTION_SIZE,
    NUM_SIDES,
    EnvState,
    Outcome,
    Policy,
    SelfPlay,
    SidePolicy,
)


class Guest(NamedTuple):
    """A frozen policy that a run trains against."""

    policy: SidePolicy  # NumPy leaves without leading axes
    observation: str = ""  # the layout that it sees, of `OBSERVATIONS`; "": that of the game flown


Cast = Mapping[str, Guest]  # by their rows' names


def counted_rows(config: Config) -> tuple[Row | None, ...]:
    """The rows whose fights are counted apart: None for live players, then the rows of the table
    but for those of nobody. Empty without `selfplay.opponents`.
    """
    if not config.selfplay.opponents:
        return ()
    return (None, *(row for row in table(config) if row.who != ALONE))


def parts(config: Config) -> tuple[slice, slice]:
    """The environments that each side learns from."""
    every = slice(0, config.train.num_envs)
    each = (live_part(config, side) for side in range(NUM_SIDES))
    defender, attacker = (ALL if part == every else part for part in each)
    return defender, attacker


def seats(combat: Combat, learners: Learners, state: SelfPlay | None, cast: Cast) -> Policies:
    """Who flies each drone: its side's live or past policy, or a function where others sit there,
    too.
    """
    config, drones = combat.config, range(len(combat.config.game.sides))
    flying = of_drones(config, players(config, learners, state))
    if not config.selfplay.opponents:
        return flying
    if chunk_rows(config):
        assert state is not None
        return tuple(_seat_of_chunks(combat, drone, flying[drone], state, cast) for drone in drones)
    return tuple(_seat_of_places(combat, drone, learners, state, cast) for drone in drones)


def of_drones(config: Config, policies: Both) -> Policies:
    """The policies of both sides as those of the drones."""
    sides = config.game.sides
    return tuple(of_drone(policies[side], sides, drone) for drone, side in enumerate(sides))


def codes(config: Config, state: SelfPlay | None) -> jax.Array:
    """Whom the learner meets in each environment, as a code [N] int32: for a past player the code
    of `met`, for another opponent FIXED minus the row's place in the table, for live players
    NOBODY.
    """
    fixed = np.full(config.train.num_envs, NOBODY, np.int32)
    code = jnp.asarray(fixed) if chunk_rows(config) == () else met(state, config.train.num_envs)
    for index, place in enumerate(places(config)):
        row = place.row
        if row is None or row.who == ALONE:
            continue
        here = slice(place.first, place.stop)
        past = NUM_SIDES * state.opponent[here] + row.side if row.past and state else FIXED - index
        code = code.at[here].set(past)
    return code


def past_sides(config: Config, state: SelfPlay) -> jax.Array:
    """The side of the past player in each environment, [N] int32; NOBODY where there is none."""
    if chunk_rows(config):
        return jnp.where(state.opponent >= 0, state.frozen, NOBODY)
    sides = np.full(config.train.num_envs, NOBODY, np.int32)
    for place in places(config):
        if place.row is not None and place.row.past:
            sides[place.first : place.stop] = place.row.side
    return jnp.asarray(sides)


def count_outcomes(
    config: Config, state: SelfPlay | None, outcomes: jax.Array, counted: jax.Array
) -> jax.Array | None:
    """Fights that count, where `counted` [T, N], with `outcomes` [T, N], by row and outcome.

    [R, 3] int32 in the order of `counted_rows`; None where there are no rows.
    """
    rows = counted_rows(config)
    if not rows:
        return None
    won = jax.nn.one_hot(outcomes, len(Outcome), dtype=jnp.int32) * counted[..., None]
    each = jnp.sum(won, axis=0)  # [N, 3]
    return jnp.stack([jnp.sum(each * _flown(config, state, row)[:, None], axis=0) for row in rows])


def _flown(config: Config, state: SelfPlay | None, row: Row | None) -> jax.Array:
    """Where `row` is flown at present, [N] int32 of 0 and 1; None: where both sides are live."""
    rows, envs = chunk_rows(config), config.train.num_envs
    if rows:
        assert state is not None
        code = NOBODY if row is None else FIXED - rows.index(row)
        here = (state.opponent >= 0) if row is not None and row.past else state.opponent == code
        side = state.frozen == (NOBODY if row is None else row.side)
        return (here & side).astype(jnp.int32)
    flown = np.zeros(envs, np.int32)
    for place in places(config):
        if place.row == row:
            flown[place.first : place.stop] = 1
    return jnp.asarray(flown)


def _seat_of_places(
    combat: Combat, drone: int, learners: Learners, state: SelfPlay | None, cast: Cast
) -> Seat | Policy:
    """Who flies `drone` where rows have environments of their own: each row flies its own part of
    them.
    """
    config, side = combat.config, combat.config.game.sides[drone]
    live = of_drone(live_policy(config, learners, side), config.game.sides, drone)
    taken = [place for place in places(config) if place.row is not None and place.row.side == side]
    if not taken:
        return live
    whole = live_part(config, side)
    flown = [Places(None, whole.start, whole.stop)] if whole.start < whole.stop else []
    sitting = [
        (place, _sitting(combat, drone, place, live, state, cast))
        for place in sorted([*taken, *flown], key=lambda place: place.first)
        if place.first < place.stop
    ]

    def act(env: EnvState, seen: jax.Array, noise: jax.Array) -> Acts:
        each = []
        for place, seat in sitting:
            part = lambda leaf, place=place: leaf[place.first : place.stop]
            each.append(seat(jax.tree.map(part, env), part(seen), part(noise)))
        return jax.tree.map(lambda *parts: jnp.concatenate(parts), *each)

    return act


def _sitting(
    combat: Combat, drone: int, place: Places, live: Policy, state: SelfPlay | None, cast: Cast
) -> Seat:
    """Who flies `drone` in the environments of one place."""
    row = place.row
    if row is None:
        return _drawn(combat.config, live, drone)
    if row.who == ALONE:  # it is absent, and its action has no effect
        return _steady(lambda env, seen, key: jnp.zeros((seen.shape[0], ACTION_SIZE)), drone)
    if row.past:
        assert state is not None
        pool = state.pools[row.side]
        assert pool is not None
        slots = jnp.maximum(state.opponent[place.first : place.stop], 0)
        past = of_drone(member(pool, slots), combat.sides, drone)
        return _drawn(combat.config, past, drone)
    return _fixed(combat, row, drone, cast)


def _seat_of_chunks(
    combat: Combat, drone: int, flying: Policy | Seat, state: SelfPlay, cast: Cast
) -> Policy | Seat:
    """Who flies `drone` where rows are drawn for chunks: its live or past policy, or a fixed row."""
    assert isinstance(flying, Policy)
    rows, side = chunk_rows(combat.config), combat.config.game.sides[drone]
    fixed = [row for row in rows if row.side == side and not row.past]
    if not fixed:
        return flying
    which: jax.Array = jnp.zeros((), jnp.int32)
    for number, row in enumerate(fixed, start=1):
        which = jnp.where(state.opponent[0] == FIXED - rows.index(row), number, which)
    choices = [
        _drawn(combat.config, flying, drone),
        *(_fixed(combat, row, drone, cast) for row in fixed),
    ]
    return lambda env, seen, noise: jax.lax.switch(which, choices, env, seen, noise)


def _fixed(combat: Combat, row: Row, drone: int, cast: Cast) -> Seat:
    """The scripted pilot or the frozen policy of a row, flying `drone`."""
    if row.scripted:
        pilot = build_pilot(row.scripted, combat.config, combat.scene, row.side, drone)
        return _steady(pilot, drone)
    guest, learn = cast[row.name], combat.config.learn
    policy = of_drone(guest.policy, combat.sides, drone)
    look = view_of(combat.config, guest.observation)

    def act(env: EnvState, seen: jax.Array, noise: jax.Array) -> Acts:
        own = look(env, seen)[:, drone]
        action, recall = policy_step(learn, policy, own, recalled(env, drone))
        return action, jnp.zeros(action.shape[0]), recall

    return act


def _drawn(config: Config, policy: Policy, drone: int) -> Seat:
    """A policy that draws its actions."""
    return lambda env, seen, noise: draw_action(
        config.learn, policy, seen[:, drone], noise, recalled(env, drone)
    )


def _steady(pilot: Pilot, drone: int) -> Seat:
    """A pilot that draws nothing; nobody asks for the probability of its actions."""

    def act(env: EnvState, seen: jax.Array, noise: jax.Array) -> Acts:
        action = pilot(env, seen, jax.random.key(0))
        return action, jnp.zeros(action.shape[0]), recalled(env, drone)

    return act
