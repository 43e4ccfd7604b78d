"""How a side learns: one entry of ALGORITHMS for each way.

What a learner holds is its algorithm's own business; self-play, tournaments and files know its
policy alone. To add one, write its functions in a file beside this, name it in ALGORITHMS and among
the choices of `config.LearnConfig.algorithm`. What does not live here: opponents (`selfplay`).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.observe import observation_of, whole_of
from dronecombat_jax.config.fields import Config, LearnConfig
from dronecombat_jax.config.own import chosen
from dronecombat_jax.config.sides import DUEL, Sides, pupils_of
from dronecombat_jax.learn.ippo import adopt, init_learner, update_learner
from dronecombat_jax.learn.mates import Both, of_mate, of_side
from dronecombat_jax.learn.rollout import policy_of, select
from dronecombat_jax.types import NUM_SIDES, Policy, SidePolicy, Transition, UpdateMetrics

Learners = Any  # of all who learn (`Config.pupils`), leaves [L, ...]
ALL = slice(None)  # environments


class Algorithm(NamedTuple):
    """Pure functions of one who learns; a learner is any pytree of arrays."""

    # (key, settings, length of the observation) -> learner; PPO's also takes `critic_size`
    init: Callable[..., Any]
    # (settings, learner, rollout leaves [T, N, A, ...], side, key) -> learner, what happened
    learn: Callable[[LearnConfig, Any, Transition, int, jax.Array], tuple[Any, UpdateMetrics]]
    policy: Callable[[Any], Policy]  # what flies of a learner; any leading axes
    adopt: Callable[[Any, Policy], Any]  # the learner, flying another policy from now on


PPO = Algorithm(init=init_learner, learn=update_learner, policy=policy_of, adopt=adopt)
ALGORITHMS: dict[str, Algorithm] = {"ppo": PPO}


def algorithm_of(learn: LearnConfig) -> Algorithm:
    """The algorithm that `learn.algorithm` names."""
    return chosen(ALGORITHMS, learn.algorithm)


def new_learner(key: jax.Array, config: Config) -> Any:
    """One learner before training, by the algorithm of `config`; a central critic gets a length of
    its own.
    """
    learn, size = config.learn, observation_of(config).size
    more = {"critic_size": whole_of(config).size} if learn.critic == "central" else {}
    return algorithm_of(learn).init(key, learn, size, **more)


def live_policy(config: Config, learners: Learners, side: int) -> SidePolicy:
    """What flies of a side's learners; `learners` leaves [L, ...]."""
    policy = algorithm_of(config.learn).policy
    return of_side(config.pupils, side, lambda index: policy(select(learners, index)))


def adopt_policies(config: Config, learners: Learners, policies: Both) -> Learners:
    """The learners, leaves [L, ...], flying the `policies` of both sides from now on."""
    take = algorithm_of(config.learn).adopt
    replaced = [
        take(select(learners, index), of_mate(policies[pupil.side], pupil.number))
        for index, pupil in enumerate(config.pupils)
    ]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *replaced)


def learn_from(
    learn: LearnConfig,
    learners: Learners,
    rollout: Transition,
    key: jax.Array,
    learning: jax.Array,
    parts: tuple[slice, slice] = (ALL, ALL),
    sides: Sides = DUEL,
) -> tuple[Learners, UpdateMetrics]:
    """Let each side that is `learning` [2] bool learn from its own part of the rollout.

    A side that does not learn keeps every bit of its state. One that learns must have flown itself:
    `parts` are the environments, one after the other, in which each side has. Where there is none,
    the side has no program at all. Team mates that share a learner are so many more environments to
    it; with a learner each (`learn.mates`), each learns from its own drone's steps.
    """
    results = []
    for index, pupil in enumerate(pupils_of(sides, learn.mates)):
        side, own_key = pupil.side, jax.random.fold_in(key, index)
        own = rollout if parts[side] == ALL else part_of(rollout, parts[side])
        if sides != DUEL:
            own = of_team(own, pupil.drones)
        learner = select(learners, index)
        if own.clock.shape[1] == 0:
            results.append((learner, _nothing()))
        else:
            results.append(_learn_if(learning[side], learn, learner, own, side, own_key))
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *results)


def part_of(rollout: Any, part: slice) -> Any:
    """The environments `part` of `rollout`, leaves [T, N, ...]."""
    return jax.tree.map(lambda leaf: leaf[:, part], rollout)


def of_team(rollout: Transition, mates: slice) -> Transition:
    """The rollout of some drones of a side, leaves [T, N n, 2, ...]: each of n team mates as if it
    were alone in an environment of its own.

    In both places of the agents' axis stands the side's own drone, so that a learner finds it in
    the place of its side.
    """
    size = mates.stop - mates.start

    def fold(leaf: jax.Array) -> jax.Array:
        steps, fights = leaf.shape[:2]
        if leaf.ndim == 2:  # of the fight
            return jnp.repeat(leaf, size, axis=1)
        own = leaf[:, :, mates].reshape(steps, fights * size, 1, *leaf.shape[3:])
        return jnp.broadcast_to(own, (steps, fights * size, NUM_SIDES, *leaf.shape[3:]))

    return jax.tree.map(fold, rollout)


def without(solo_envs: int, rollout: Any) -> Any:
    """The environments of `rollout`, leaves [T, N, ...], in which both fly: all but the first
    `solo_envs`.
    """
    return part_of(rollout, slice(solo_envs, None)) if solo_envs else rollout


def _learn_if(
    learning: jax.Array,
    learn: LearnConfig,
    learner: Any,
    rollout: Transition,
    side: int,
    key: jax.Array,
) -> tuple[Any, UpdateMetrics]:
    def update(learner: Any) -> tuple[Any, UpdateMetrics]:
        return algorithm_of(learn).learn(learn, learner, rollout, side, key)

    return jax.lax.cond(learning, update, lambda learner: (learner, _nothing()), learner)


def _nothing() -> UpdateMetrics:
    """The report of one who does not learn."""
    blank = dict.fromkeys(UpdateMetrics._fields, jnp.zeros(()))
    return UpdateMetrics(**blank | {"skipped": jnp.zeros((), jnp.int32)})
