"""Collecting experience: both policies fly N fights for T steps, with automatic reset."""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.progress import progress
from dronecombat_jax.combat.scripted import Pilot, build_pilot, check_teachers
from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.config.opponents import strike_margins
from dronecombat_jax.learn.memory import remember, with_recall
from dronecombat_jax.learn.networks import forward, gaussian_log_prob
from dronecombat_jax.learn.normalize import normalize
from dronecombat_jax.types import (
    ACTION_SIZE,
    EnvState,
    Learner,
    Policy,
    Scaler,
    StepOutput,
    Transition,
)

Acts = tuple[jax.Array, jax.Array, jax.Array | None]
# Whoever does not learn from its actions: (fights [N, ...], observation [N, A, 35], standard normal
# noise [N, 4]) -> action [N, 4], its log-probability [N], 0 where nobody will ask for it, and what is
# remembered after it [N, M].
Seat = Callable[[EnvState, jax.Array, jax.Array], Acts]
# Who flies each drone [A]: its side's policy, leaves [...], or [N, ...] for one in each environment.
# Or a function, where different ones sit in a side's place.
Policies = tuple[Policy | Seat, ...]


def collect(
    combat: Combat,
    policies: Policies,
    env: EnvState,
    noise_key: jax.Array,
    spawn_key: jax.Array,
) -> tuple[EnvState, Transition]:
    """Fly `rollout_steps` steps in every environment.

    `env` leaves [N, ...]. All random numbers are made before the scan: one call each, and XLA's
    CPU runtime has deadlocked where a scan made them.
    """
    learn = combat.config.learn
    num_envs = env.clock.shape[0]
    alone = jnp.arange(num_envs) < combat.config.solo_envs
    steps = learn.rollout_steps
    noise = jax.random.normal(
        noise_key, (steps, num_envs, len(combat.config.game.sides), ACTION_SIZE)
    )
    numbers = combat.exploring_numbers(spawn_key, (steps, num_envs))
    margins = strike_margins(combat.config)
    margin = (jnp.asarray(margins),) if margins else ()
    teach = teaching(combat)

    def fly(env: EnvState, random: tuple[jax.Array, jax.Array]) -> tuple[EnvState, Transition]:
        noise, numbers = random
        observation = jax.vmap(combat.observe)(env)
        action, log_prob, recall = act(learn, policies, observation, noise, env)
        after, output = jax.vmap(combat.step)(env, action, *margin)
        done = output.terminated | output.truncated
        start = jax.vmap(combat.explore)(numbers, alone)
        transition = _transition(observation, action, log_prob, output, after)
        more = jax.vmap(functools.partial(progress, combat.config))(env, after, output)
        transition = transition._replace(progress=more, lesson=teach(env, observation))
        if recall is not None:
            after, start = after.replace(recall=recall), with_recall(start, recall.shape[-1])
            transition = transition._replace(recall=env.recall)
        following = jax.tree.map(
            lambda new, old: jnp.where(done.reshape(-1, *[1] * (new.ndim - 1)), new, old),
            start,
            after,
        )
        if learn.critic == "central":
            look = jax.vmap(combat.observe_whole)
            transition = transition._replace(whole=look(env), final_whole=look(after))
        return following, transition

    return jax.lax.scan(fly, env, (noise, numbers))


def teaching(combat: Combat) -> Callable[[EnvState, jax.Array], jax.Array | None]:
    """A function from fights [N, ...] and what is observed [N, A, 35] to what each drone's teacher would
    do, [N, A, 4] within -1 to 1: 0 for drones without one, None where nobody has one.

    UserError for a teacher who is no scripted pilot of that side.
    """
    if not any(combat.config.learn.teachers):
        return lambda *_: None
    check_teachers(combat.config)
    pilots = [_teacher(combat, drone) for drone in range(len(combat.sides))]

    def teach(env: EnvState, observation: jax.Array) -> jax.Array:
        nothing, unused = jnp.zeros((observation.shape[0], ACTION_SIZE)), jax.random.key(0)
        each = [pilot(env, observation, unused) if pilot else nothing for pilot in pilots]
        return jnp.clip(jnp.stack(each, axis=1), -1.0, 1.0)

    return teach


def _teacher(combat: Combat, drone: int) -> Pilot | None:
    side = combat.sides[drone]
    name = combat.config.learn.teachers[side]
    return build_pilot(name, combat.config, combat.scene, side, drone) if name else None


def act(
    learn: LearnConfig,
    policies: Policies,
    observation: jax.Array,
    noise: jax.Array,
    env: EnvState | None = None,
) -> Acts:
    """Draw all agents' actions [N, A, 4] and their log-probabilities [N, A]; also what is
    remembered after them [N, A, M].

    `observation` [N, A, 35], `noise` [N, A, 4] standard normal; the fights `env` [N, ...] for
    those of `policies` that are functions or remember their fight.
    """
    each = []
    for agent, policy in enumerate(policies):
        # unrolled: plain products beat one batched product on a CPU
        if isinstance(policy, Policy):
            recall = None if env is None else recalled(env, agent)
            each.append(draw_action(learn, policy, observation[:, agent], noise[:, agent], recall))
        else:
            assert env is not None
            each.append(policy(env, observation, noise[:, agent]))
    action, log_prob, recall = jax.tree.map(lambda *leaves: jnp.stack(leaves, axis=1), *each)
    return action, log_prob, recall


def recalled(fights: EnvState, agent: int) -> jax.Array | None:
    """What one agent's policy remembers of `fights` [N, ...]: [N, M]; None: nothing."""
    return None if fights.recall is None else fights.recall[:, agent]


def draw_action(
    learn: LearnConfig,
    policy: Policy,
    observation: jax.Array,
    noise: jax.Array,
    recall: jax.Array | None = None,
) -> Acts:
    """One agent's actions [N, 4] and their log-probabilities [N] for raw observations [N, 35];
    also what is remembered after them, `recall` [N, M] being what is before.

    The log-probability is that of the unclipped Gaussian action, unless `clip_actions` (with which
    nothing is learnt: docs/fidelity.md).
    """
    mean, recall = policy_step(learn, policy, observation, recall)
    log_std = jnp.clip(policy.log_std, learn.least_log_std, learn.max_log_std)
    action = mean + jnp.exp(log_std) * noise
    if learn.clip_actions:
        action = jnp.clip(action, -1.0, 1.0)
    return action, gaussian_log_prob(action, mean, log_std), recall


def policy_mean(learn: LearnConfig, policy: Policy, observation: jax.Array) -> jax.Array:
    """Mean action [..., 4] for raw observations [..., 35]; a policy with leaves [N, ...] flies
    observations [N, 35]. For policies without memory.
    """
    return policy_step(learn, policy, observation, None)[0]


def policy_step(
    learn: LearnConfig, policy: Policy, observation: jax.Array, recall: jax.Array | None
) -> tuple[jax.Array, jax.Array | None]:
    """The same, and what is remembered after it [..., M], `recall` being what is before."""
    if policy.log_std.ndim > 1:
        return jax.vmap(lambda *each: policy_step(learn, *each))(policy, observation, recall)
    seen = scaled(learn, policy.observation_scaler, observation)
    inputs, recall = remember(policy, seen, recall)
    return forward(policy.network, inputs), recall


def scaled(learn: LearnConfig, scaler: Scaler, observation: jax.Array) -> jax.Array:
    """The observation as the networks see it."""
    return normalize(scaler, observation) if learn.normalize_observations else observation


def policy_of(learner: Learner) -> Policy:
    """The policy of a learner; any leading axes."""
    parameters = learner.parameters
    return Policy(parameters.policy, parameters.log_std, learner.observation_scaler, parameters.gru)


def select(learners: Learner, agent: int) -> Learner:
    """One agent's learner out of leaves [A, ...]."""
    return jax.tree.map(lambda leaf: leaf[agent], learners)


def _transition(
    observation: jax.Array,
    action: jax.Array,
    log_prob: jax.Array,
    output: StepOutput,
    after: EnvState,
) -> Transition:
    return Transition(
        observation=observation,
        action=action,
        log_prob=log_prob,
        reward=output.reward,
        terminated=output.terminated,
        truncated=output.truncated,
        final_observation=output.observation,
        cause=output.cause,
        clock=after.clock,
        down=after.crashed,
        active=output.active,
        idle=output.idle,
        reward_terms=output.reward_terms,
    )
