"""What training knows of each fight under way: the steps flown, the rewards earned, and who has
flown it.

A fight counts in outcome shares, lengths, returns and records of wins if it was flown from its
start to its end by the same two. Fights go on over a chunk's boundary, where the opponent may
change, and the clocks of a run's first fights begin anywhere: such fights teach as any other, and
count nowhere. What does not live here: the counting itself (`summary`).
"""

import jax
import jax.numpy as jnp

from dronecombat_jax.types import Flown, Transition

MIXED = -2  # as `Flown.met`: its opponent changed, or is not known


def fresh(num_envs: int, drones: int) -> Flown:
    """Fights about to start, of so many drones each."""
    steps = jnp.zeros(num_envs, jnp.int32)
    return Flown(
        steps=steps, returns=jnp.zeros((num_envs, drones)), met=jnp.full_like(steps, MIXED)
    )


def unknown(num_envs: int, drones: int) -> Flown:
    """Fights under way of which nothing is known: they never count, since their steps never equal
    their clock.
    """
    return fresh(num_envs, drones).replace(steps=jnp.full(num_envs, -1, jnp.int32))


def follow(flown: Flown, rollout: Transition, met: jax.Array) -> tuple[Flown, Flown]:
    """Go through `rollout` [T, N, ...], flown against `met` [N]; returns the state after it, and at
    each step [T, N].

    A step's own state includes the step and comes before any reset.
    """
    same = (flown.met == met) | (flown.steps == 0)
    flown = flown.replace(met=jnp.where(same, met, MIXED))

    def step(flown: Flown, step: tuple[jax.Array, jax.Array]) -> tuple[Flown, Flown]:
        reward, done = step
        now = flown.replace(steps=flown.steps + 1, returns=flown.returns + reward)
        after = Flown(
            steps=jnp.where(done, 0, now.steps),
            returns=jnp.where(done[:, None], 0.0, now.returns),
            met=jnp.where(done, met, now.met),
        )
        return after, now

    return jax.lax.scan(step, flown, (rollout.reward, rollout.terminated | rollout.truncated))


def counted(flown: Flown, rollout: Transition) -> jax.Array:
    """Where a fight ended that counts, [T, N] bool; `flown` [T, N] as `follow` returns it."""
    whole = (flown.steps == rollout.clock) & (flown.met != MIXED)
    return (rollout.terminated | rollout.truncated) & whole
