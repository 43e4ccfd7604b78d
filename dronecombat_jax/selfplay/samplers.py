"""Which past opponent to meet, and what a fight against one is worth in the records: small pure functions.

A sampler gives every member of the pool a weight; the pool draws in proportion to it (`pool.draw`).
To add one, write a function here, name it in `SAMPLERS` and among the choices of
`config.SelfPlayConfig.sampler`.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp

from dronecombat_jax.config.fields import SelfPlayConfig


class Members(NamedTuple):
    """What a sampler sees of a pool of K slots."""

    slot: jax.Array  # [K] int32: 0, 1, ..., K - 1; the untrained player is slot 0
    filled: jax.Array  # [] int32, slots in use: the newest member is slot filled - 1
    # [K] x, the live learner's share of wins against each member, or its mean grade
    # (`selfplay.record`); 1/2 where they never met
    win_rate: jax.Array


Sampler = Callable[[Members, SelfPlayConfig], jax.Array]


def uniform(members: Members, selfplay: SelfPlayConfig) -> jax.Array:
    """Every past player is equally likely: fictitious self-play (the paper; Heinrich, Lanctot and
    Silver 2015).
    """
    return jnp.ones_like(members.win_rate)


def latest(members: Members, selfplay: SelfPlayConfig) -> jax.Array:
    """The newest past player alone: naive self-play against an opponent that does not change for a
    chunk.
    """
    return (members.slot == members.filled - 1).astype(jnp.float32)


def delta_uniform(members: Members, selfplay: SelfPlayConfig) -> jax.Array:
    """The newest share `delta` of the pool, each member equally likely.

    Bansal et al. (2018), section 4.2; their delta is 1 - ours.
    """
    oldest = jnp.floor((1.0 - selfplay.delta) * members.filled.astype(jnp.float32))
    return (members.slot >= jnp.minimum(oldest, members.filled - 1)).astype(jnp.float32)


def pfsp_hard(members: Members, selfplay: SelfPlayConfig) -> jax.Array:
    """(1 - x)^k: those who beat the learner (Vinyals et al. 2019, prioritised fictitious
    self-play).
    """
    return (1.0 - members.win_rate) ** selfplay.pfsp_power


def pfsp_variance(members: Members, selfplay: SelfPlayConfig) -> jax.Array:
    """x (1 - x): those about as strong as the learner (Vinyals et al. 2019, supplement)."""
    return members.win_rate * (1.0 - members.win_rate)


def latest_and_hard(members: Members, selfplay: SelfPlayConfig) -> jax.Array:
    """Half of the opponents are the newest, half are chosen by (1 - x)^k among all, the newest
    included.

    Gavin and Bronz (2026, arXiv 2607.05939), with k = 2 and x graded: `selfplay.record` rho.
    """
    filled = members.slot < members.filled
    hard = jnp.where(filled, pfsp_hard(members, selfplay), 0.0)
    total = jnp.sum(hard)
    return latest(members, selfplay) + hard / jnp.where(total > 0.0, total, 1.0)


SAMPLERS: dict[str, Sampler] = {
    "uniform": uniform,
    "latest": latest,
    "delta_uniform": delta_uniform,
    "pfsp_hard": pfsp_hard,
    "pfsp_variance": pfsp_variance,
    "latest_and_hard": latest_and_hard,
}

# (live learner won, fight tied, rho = 1 - t / T of a fight of t steps out of at most T) -> its
# worth to the live learner, from 0 to 1; all of one shape
Grade = Callable[[jax.Array, jax.Array, jax.Array], jax.Array]


def win(won: jax.Array, tied: jax.Array, rho: jax.Array) -> jax.Array:
    """A win counts 1, a tie 1/2, a loss 0."""
    return jnp.where(won, 1.0, jnp.where(tied, 0.5, 0.0))


def rho(won: jax.Array, tied: jax.Array, rho: jax.Array) -> jax.Array:
    """A win counts rho, more the sooner it comes; all else 0 (Gavin and Bronz 2026, arXiv
    2607.05939).
    """
    return jnp.where(won, rho, 0.0)


def margin(won: jax.Array, tied: jax.Array, rho: jax.Array) -> jax.Array:
    """A win counts (1 + rho) / 2, a tie 1/2, a loss (1 - rho) / 2: it matters to both sides how
    soon.

    The two sides' grades add up to 1, so 1/2 is an even opponent, as with `win`.
    """
    return jnp.where(won, 0.5 + 0.5 * rho, jnp.where(tied, 0.5, 0.5 - 0.5 * rho))


GRADES: dict[str, Grade] = {"win": win, "rho": rho, "margin": margin}
