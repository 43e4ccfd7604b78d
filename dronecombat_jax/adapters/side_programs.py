"""The jitted programs of a host's environment of one side: N fights begin and step in one call.

What does not live here: one fight (`one_side`), a library's protocol (`gymnasium_env`).
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from dronecombat_jax.adapters.one_side import Bout, OneSide, choose, earned, fight_keys, seen
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.scripted import Pilot


class Flown(NamedTuple):
    """What one call yields for N fights; arrays of JAX, or of NumPy once they are copied."""

    # [N, 35] of the fight that goes on, or has newly begun; for a team of M drones [N, 35 M]
    observation: Any
    final_observation: Any  # the same after the step, before any new beginning
    reward: Any  # [N]
    terminated: Any  # [N] bool
    truncated: Any  # [N] bool
    cause: Any  # [N] int32


class Programs(NamedTuple):
    """The programs of one kind of environment."""

    keys: Callable[..., jax.Array]  # (words [2] of a seed, N) -> [N]
    begin: Callable[[jax.Array], tuple[Bout, jax.Array]]  # keys [N] -> fights, observation [N, 35]
    # (fights, keys [N], mask [N] bool) -> fights, observation [N, 35]; where the mask is, anew
    renew: Callable[..., tuple[Bout, jax.Array]]
    # (fights, actions [N, 4], over [N] bool before the step) -> fights, Flown
    step: Callable[..., tuple[Bout, Flown]]


@functools.lru_cache(maxsize=32)
def programs(
    combat: Combat, role: int, pilots: tuple[Pilot, ...], mode: str, exploring: bool = False
) -> Programs:
    """The programs by which an ended fight begins anew as `mode` says: SAME_STEP, NEXT_STEP,
    DISABLED.

    The fights of a seed are the same in all modes. Environments of the same arguments share the
    programs.
    """
    side = OneSide(combat, role, pilots, exploring)
    own = jax.vmap(functools.partial(seen, combat, role))
    reward_of = jax.vmap(functools.partial(earned, combat, role))

    def begin(keys: jax.Array) -> tuple[Bout, jax.Array]:
        bout = jax.vmap(side.start)(keys)
        return bout, jax.vmap(side.observe)(bout)

    def renew(bout: Bout, keys: jax.Array, mask: jax.Array) -> tuple[Bout, jax.Array]:
        bout = choose(mask, begin(keys)[0], bout)
        return bout, jax.vmap(side.observe)(bout)

    def step(bout: Bout, action: jax.Array, over: jax.Array) -> tuple[Bout, Flown]:
        after, output = jax.vmap(side.step)(bout, action)
        final, reward = own(output.observation), reward_of(output.reward)
        ended = output.terminated | output.truncated
        flown = Flown(final, final, reward, output.terminated, output.truncated, output.cause)
        if mode == "SAME_STEP":
            begun, first = begin(after.key)
            return choose(ended, begun, after), flown._replace(
                observation=choose(ended, first, final)
            )
        if mode == "NEXT_STEP":
            begun, first = begin(bout.key)
            nothing = Flown(first, first, *(jnp.zeros_like(leaf) for leaf in flown[2:]))
            return choose(over, begun, after), choose(over, nothing, flown)
        return after, flown

    keys = jax.jit(fight_keys, static_argnums=1)
    return Programs(keys, jax.jit(begin), jax.jit(renew), jax.jit(step))
