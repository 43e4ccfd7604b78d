"""The pool of past players: saving them, drawing from them, playing them, counting wins against
them.

Everything is arrays in the jitted program. Past players are rows of the table of opponents
(`config.opponents`). With rows of chunks, a chunk is either live, and both agents learn, or frozen:
one role is then played by its past (or another opponent of the table), and only the other learns.
With rows of environments no chunk is frozen, and each row has its own environments. What does not
live here: the weights by which past players are drawn (`samplers`), who else is met (`opponents`)
and the order of events in a chunk (`chunk`).
"""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp

from dronecombat_jax.config.fields import Config, SelfPlayConfig
from dronecombat_jax.config.opponents import Row, places, table
from dronecombat_jax.config.own import chosen
from dronecombat_jax.learn.algorithms import Learners, adopt_policies, live_policy
from dronecombat_jax.learn.mates import Both
from dronecombat_jax.selfplay.samplers import GRADES, SAMPLERS, Grade, Members
from dronecombat_jax.types import (
    ATTACKER,
    DEFENDER,
    NUM_SIDES,
    Outcome,
    Pool,
    SelfPlay,
    SidePolicy,
)

NOBODY = -1
FIXED = (
    -3
)  # `SelfPlay.opponent` of row r of chunks that is no past player: FIXED - r; -2 is `tally.MIXED`


def chunk_rows(config: Config) -> tuple[Row, ...]:
    """The rows of the table that are drawn for whole chunks."""
    return tuple(row for row in table(config) if row.of_chunks)


def past_roles(config: Config) -> tuple[int, ...]:
    """The roles whose past is played: the opponents of those who meet it."""
    return tuple(sorted({row.side for row in table(config) if row.past}))


def init_selfplay(config: Config, learners: Learners) -> SelfPlay | None:
    """Empty pools with a slot for every chunk; None where no opponent is ever drawn. `learners`
    leaves [L, ...].
    """
    roles = past_roles(config)
    if not roles and not chunk_rows(config):
        return None
    slots = config.num_chunks

    def empty(role: int) -> Pool | None:
        if role not in roles:
            return None
        policies = jax.tree.map(
            lambda leaf: jnp.zeros((slots, *leaf.shape), leaf.dtype),
            live_policy(config, learners, role),
        )
        return Pool(policies, wins=jnp.zeros(slots), games=jnp.zeros(slots))

    nobody = jnp.asarray(NOBODY, jnp.int32)
    opponent = jnp.full(config.train.num_envs, NOBODY, jnp.int32)
    return SelfPlay(pools=(empty(DEFENDER), empty(ATTACKER)), frozen=nobody, opponent=opponent)


def save_players(config: Config, state: SelfPlay, learners: Learners, slot: jax.Array) -> SelfPlay:
    """Save the live players, `learners` leaves [L, ...], in slot `slot` []; the records of wins
    fade.

    They were won by a learner that has moved on since.
    """
    pools = []
    for role, pool in enumerate(state.pools):
        if pool is not None:
            put = lambda leaf, new: jax.lax.dynamic_update_index_in_dim(leaf, new, slot, axis=0)
            memory = config.selfplay.memory
            policies = jax.tree.map(put, pool.policies, live_policy(config, learners, role))
            pool = Pool(policies, wins=memory * pool.wins, games=memory * pool.games)
        pools.append(pool)
    return state.replace(pools=tuple(pools))


def member(pool: Pool, slots: jax.Array) -> SidePolicy:
    """The past player in each of `slots` [...]; leaves [..., ...]."""
    return jax.tree.map(lambda leaf: leaf[slots], pool.policies)


def win_rates(pool: Pool) -> jax.Array:
    """[K] share of wins of the live learner against each member, or its mean grade
    (`selfplay.record`), shrunk towards 1/2 (Laplace's rule).
    """
    return (pool.wins + 1.0) / (pool.games + 2.0)


def draw(
    selfplay: SelfPlayConfig, pool: Pool, filled: jax.Array, key: jax.Array, shape: tuple[int, ...]
) -> jax.Array:
    """Slots [*shape] int32 of past players, by the sampler's weights; a slot that is not filled is
    never drawn.

    Where all weights are 0 (nobody is worth meeting), every member is as good.
    """
    slot = jnp.arange(pool.games.shape[0], dtype=jnp.int32)
    weights = chosen(SAMPLERS, selfplay.sampler)(Members(slot, filled, win_rates(pool)), selfplay)
    weights = jnp.where(slot < filled, weights, 0.0)
    weights = jnp.where(jnp.any(weights > 0.0), weights, (slot < filled).astype(jnp.float32))
    return jax.random.categorical(key, jnp.log(weights), shape=shape).astype(jnp.int32)


def choose(config: Config, state: SelfPlay, chunk: jax.Array, key: jax.Array) -> SelfPlay:
    """Draw who is met in chunk `chunk` [] int32; the pools must hold the players of this chunk's
    start.

    With probability p, the sum of their shares, one row of chunks is drawn and the chunk is frozen;
    never the first one, nor any of the attacker's head start. Without such rows each environment of
    a past row draws its own member.
    """
    selfplay, rows = config.selfplay, chunk_rows(config)
    coin, lot, *keys = jax.random.split(key, 2 + NUM_SIDES)
    num_envs = state.opponent.shape[0]
    opponent = jnp.full(num_envs, NOBODY, jnp.int32)
    if not rows:
        return state.replace(opponent=_draw_places(config, state, chunk, keys, opponent))
    frozen = (
        (jax.random.uniform(coin) < sum(row.share or 0.0 for row in rows))
        & (chunk > 0)
        & (chunk >= config.head_start_chunks)
    )
    which = _draw_row(rows, lot)
    shape = () if selfplay.scope == "chunk" else (num_envs,)
    for index, row in enumerate(rows):
        here: jax.Array = jnp.asarray(FIXED - index, jnp.int32)
        if row.past:
            here = _draw_past(config, state, row, chunk, keys[row.side], shape)
        here = jnp.broadcast_to(here, (num_envs,))
        opponent = jnp.where(frozen & (which == index), here, opponent)
    side = jnp.asarray([row.side for row in rows], jnp.int32)[which]
    return state.replace(frozen=jnp.where(frozen, side, NOBODY), opponent=opponent)


def _draw_row(rows: tuple[Row, ...], key: jax.Array) -> jax.Array:
    """The number [] of one of `rows`, by their shares."""
    shares = [row.share or 0.0 for row in rows]
    if len(set(shares)) == 1:
        return jax.random.randint(key, (), 0, len(rows))
    return jax.random.categorical(key, jnp.log(jnp.asarray(shares)))


def _draw_places(
    config: Config,
    state: SelfPlay,
    chunk: jax.Array,
    keys: list[jax.Array],
    opponent: jax.Array,
) -> jax.Array:
    """Slots of past players in the environments of past rows; `opponent` [N] elsewhere. `keys` by
    side.
    """
    for index, place in enumerate(places(config)):
        if place.row is not None and place.row.past:
            key = jax.random.fold_in(keys[place.row.side], index)
            shape = (place.stop - place.first,)
            slots = _draw_past(config, state, place.row, chunk, key, shape)
            opponent = opponent.at[place.first : place.stop].set(slots)
    return opponent


def _draw_past(
    config: Config,
    state: SelfPlay,
    row: Row,
    chunk: jax.Array,
    key: jax.Array,
    shape: tuple[int, ...],
) -> jax.Array:
    """Slots [*shape] int32 of past players of a row, by its own sampler or `selfplay.sampler`."""
    pool, selfplay = state.pools[row.side], config.selfplay
    assert pool is not None
    if row.sampler:
        selfplay = replace(selfplay, sampler=row.sampler)  # pyright: ignore[reportArgumentType]
    return draw(selfplay, pool, chunk + 1, key, shape)


def players(config: Config, learners: Learners, state: SelfPlay | None) -> Both:
    """Who flies: the live policies, and a past one in the frozen role.

    A past policy's leaves are [...] where one is met by all, and [N, ...] with scope "environment".
    """
    live = live_policy(config, learners, DEFENDER), live_policy(config, learners, ATTACKER)
    rows = chunk_rows(config)
    if state is None or not rows:
        return live
    flying = list(live)
    for role in sorted({row.side for row in rows if row.past}):
        pool = state.pools[role]
        assert pool is not None
        slots = state.opponent[0] if config.selfplay.scope == "chunk" else state.opponent
        past = member(pool, jnp.maximum(slots, 0))  # nobody: any slot will do, it is not played
        flying[role] = jax.tree.map(partial(jnp.where, state.frozen == role), past, live[role])
    return flying[DEFENDER], flying[ATTACKER]


def lose_live(config: Config, learners: Learners, state: SelfPlay) -> Learners:
    """`learners` after a frozen chunk in the authors' script, which loses the live player: from
    then on the past player learns in its place.

    Only the policy is replaced. A critic, for example, stays that of the live player.
    """
    return adopt_policies(config, learners, players(config, learners, state))


def met(state: SelfPlay | None, num_envs: int) -> jax.Array:
    """Whom the learner meets in each environment of a chunk, as a code [N] int32: NOBODY for live
    players, role and slot of a past one, else FIXED minus the number of the row of chunks.
    """
    if state is None:
        return jnp.full(num_envs, NOBODY, jnp.int32)
    past = NUM_SIDES * state.opponent + state.frozen
    code = jnp.where(state.opponent <= FIXED, state.opponent, past)
    return jnp.where(state.frozen == NOBODY, NOBODY, code)


def count_wins(
    state: SelfPlay,
    outcomes: jax.Array,
    counted: jax.Array,
    rho: jax.Array,
    grade: Grade = GRADES["win"],
    sides: jax.Array | None = None,
) -> SelfPlay:
    """Enter the fights that count, where `counted` [T, N], with `outcomes` [T, N] (`Outcome`), into
    the records, each by its `grade`.

    `rho` [T, N]: 1 - t / T of a fight of t control steps, at most T. The present past player must
    have flown all of them (`tally.counted`). `sides` [N]: whose past is met in each environment
    (`opponents.past_sides`); None: the frozen role's in all.
    """
    sides = state.frozen if sides is None else sides
    pools = []
    for past, pool in enumerate(state.pools):
        if pool is None:
            pools.append(None)
            continue
        lost = Outcome.DEFENDER if past == ATTACKER else Outcome.ATTACKER  # the live player's win
        score = grade(outcomes == lost, outcomes == Outcome.DRAW, rho)
        played = counted & (sides == past)
        member = jnp.maximum(state.opponent, 0)
        add = lambda record, counts: record.at[member].add(jnp.sum(counts, axis=0))  # noqa: B023 - used at once
        pools.append(
            pool.replace(
                wins=add(pool.wins, score * played),
                games=add(pool.games, played.astype(jnp.float32)),
            )
        )
    return state.replace(pools=tuple(pools))


def resize(state: SelfPlay, slots: int) -> SelfPlay:
    """The state with pools of `slots` slots, empty ones added or dropped: a run may be made longer.
    Leaves [S, ...].
    """

    def fit(leaf: jax.Array) -> jax.Array:
        missing = slots - leaf.shape[1]
        return jnp.pad(leaf, [(0, 0), (0, max(missing, 0)), *[(0, 0)] * (leaf.ndim - 2)])[:, :slots]

    return state.replace(pools=tuple(jax.tree.map(fit, pool) for pool in state.pools))
