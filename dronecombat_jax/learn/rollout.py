"""Collecting experience: both policies fly N fights for T steps, with automatic reset."""

from collections.abc import Callable

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.fields import LearnConfig
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

# Whoever does not learn from its actions: (fights [N, ...], observation [N, A, 35], standard normal
# noise [N, 4]) -> action [N, 4], its log-probability [N]; 0 where nobody will ask for it.
Seat = Callable[[EnvState, jax.Array, jax.Array], tuple[jax.Array, jax.Array]]
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

    def fly(env: EnvState, random: tuple[jax.Array, jax.Array]) -> tuple[EnvState, Transition]:
        noise, numbers = random
        observation = jax.vmap(combat.observe)(env)
        action, log_prob = act(learn, policies, observation, noise, env)
        after, output = jax.vmap(combat.step)(env, action)
        done = output.terminated | output.truncated
        following = jax.tree.map(
            lambda new, old: jnp.where(done.reshape(-1, *[1] * (new.ndim - 1)), new, old),
            jax.vmap(combat.explore)(numbers, alone),
            after,
        )
        transition = _transition(observation, action, log_prob, output, after)
        if learn.critic == "central":
            look = jax.vmap(combat.observe_whole)
            transition = transition._replace(whole=look(env), final_whole=look(after))
        return following, transition

    return jax.lax.scan(fly, env, (noise, numbers))


def act(
    learn: LearnConfig,
    policies: Policies,
    observation: jax.Array,
    noise: jax.Array,
    env: EnvState | None = None,
) -> tuple[jax.Array, jax.Array]:
    """Draw all agents' actions [N, A, 4] and their log-probabilities [N, A].

    `observation` [N, A, 35], `noise` [N, A, 4] standard normal; the fights `env` [N, ...] for
    those of `policies` that are functions.
    """
    actions, log_probs = [], []
    for agent, policy in enumerate(policies):
        # unrolled: plain products beat one batched product on a CPU
        if isinstance(policy, Policy):
            action, log_prob = draw_action(learn, policy, observation[:, agent], noise[:, agent])
        else:
            assert env is not None
            action, log_prob = policy(env, observation, noise[:, agent])
        actions.append(action)
        log_probs.append(log_prob)
    return jnp.stack(actions, axis=1), jnp.stack(log_probs, axis=1)


def draw_action(
    learn: LearnConfig, policy: Policy, observation: jax.Array, noise: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """One agent's actions [N, 4] and their log-probabilities [N] for raw observations [N, 35].

    The log-probability is that of the unclipped Gaussian action, unless `clip_actions` (with which
    nothing is learnt: docs/fidelity.md).
    """
    mean = policy_mean(learn, policy, observation)
    log_std = jnp.clip(policy.log_std, learn.min_log_std, learn.max_log_std)
    action = mean + jnp.exp(log_std) * noise
    if learn.clip_actions:
        action = jnp.clip(action, -1.0, 1.0)
    return action, gaussian_log_prob(action, mean, log_std)


def policy_mean(learn: LearnConfig, policy: Policy, observation: jax.Array) -> jax.Array:
    """Mean action [..., 4] for raw observations [..., 35]; a policy with leaves [N, ...] flies
    observations [N, 35].
    """
    if policy.log_std.ndim > 1:
        return jax.vmap(lambda single, seen: policy_mean(learn, single, seen))(policy, observation)
    return forward(policy.network, scaled(learn, policy.observation_scaler, observation))


def scaled(learn: LearnConfig, scaler: Scaler, observation: jax.Array) -> jax.Array:
    """The observation as the networks see it."""
    return normalize(scaler, observation) if learn.normalize_observations else observation


def policy_of(learner: Learner) -> Policy:
    """The policy of a learner; any leading axes."""
    return Policy(learner.parameters.policy, learner.parameters.log_std, learner.observation_scaler)


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
