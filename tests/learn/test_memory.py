"""Policies that remember their fight: what their networks see, and what only they can learn."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from probes import STEPS, Probe, paid_at_last

from dronecombat_jax.config.fields import Config, LearnConfig, TrainConfig
from dronecombat_jax.learn.ippo import estimate_values, init_learner, update_learner
from dronecombat_jax.learn.memory import memory_size, recall_size, remember, with_recall
from dronecombat_jax.learn.networks import forward
from dronecombat_jax.learn.rollout import collect, policy_of, policy_step, scaled, select
from dronecombat_jax.types import ATTACKER, DEFENDER, EnvState

LEARN = LearnConfig(
    hidden_sizes=(16, 16),
    rollout_steps=2 * STEPS,
    epochs=4,
    minibatches=4,
    discount=0.9,
    learning_rate=3e-3,
    entropy_scale=0.0,
)
FRAMES = replace(LEARN, memory="frames", frames=STEPS)
GRU = replace(LEARN, memory="gru", memory_size=8)
REMEMBERING = pytest.mark.parametrize("learn", [FRAMES, GRU], ids=lambda learn: learn.memory)


class Cue(Probe):
    """What to do in the last step, -1 or 1, is shown in the first one alone."""

    def first(self, numbers: jax.Array) -> jax.Array:
        return jnp.where(numbers < 0.5, -1.0, 1.0)

    def observe(self, state: EnvState) -> jax.Array:
        shown = jnp.where(state.clock == 0, state.qpos, 0.0)
        return jnp.zeros((2, 35)).at[:, 0].set(state.clock).at[:, 1].set(shown)

    def paid(self, state: EnvState, action: jax.Array) -> tuple[jax.Array, jax.Array]:
        return state.qpos, -((action - state.qpos) ** 2)


def untrained(learn: LearnConfig):
    return jax.vmap(lambda key: init_learner(key, learn))(jax.random.split(jax.random.key(1)))


def probe_of(learn: LearnConfig, num_envs: int = 64) -> Cue:
    return Cue(Config(learn=learn, train=TrainConfig(num_envs=num_envs)))


@pytest.mark.slow
@REMEMBERING
def test_a_cue_that_has_gone_is_obeyed_by_a_policy_with_memory(learn):
    assert np.all(paid_at_last(probe_of(learn), untrained(learn)) > -0.3)


@pytest.mark.slow
def test_a_cue_that_has_gone_cannot_be_obeyed_by_a_policy_that_sees_the_present_alone():
    # The best it can do is 0 always, which costs 1.
    paid = paid_at_last(probe_of(LEARN), untrained(LEARN))
    assert np.all((paid < -0.9) & (paid > -1.6)), paid


@pytest.fixture(scope="module", params=[FRAMES, GRU], ids=lambda learn: learn.memory)
def flown(request):
    """A rollout of fights that began before it, and began anew in it; who flew it."""
    learn = request.param
    probe, learners = probe_of(learn, num_envs=4), untrained(learn)
    policies = policy_of(select(learners, DEFENDER)), policy_of(select(learners, ATTACKER))
    env = jax.vmap(probe.explore, (0, None))(jax.random.uniform(jax.random.key(2), (4, 2)), False)
    env = env.replace(clock=jnp.asarray([0, 1, 2, 1]))
    size = recall_size(probe.config)
    seen = jax.random.normal(jax.random.key(5), (4, 2, size))
    env = with_recall(env, size).replace(recall=0.3 * seen)
    fly = jax.jit(lambda env: collect(probe, policies, env, jax.random.key(3), jax.random.key(4)))  # pyright: ignore
    after, rollout = fly(env)
    return learn, learners, env, after, rollout


@pytest.mark.long
def test_what_is_remembered_ends_with_the_fight(flown):
    learn, _, env, after, rollout = flown
    assert np.array_equal(rollout.recall[0], env.recall)
    for n, clock in enumerate([0, 1, 2, 1]):
        for step in range(learn.rollout_steps):
            fresh = (step + clock) % STEPS == 0
            recall = rollout.recall[step, n]
            assert fresh == (not np.any(recall)) or step == 0, (n, step)
    ended = rollout.terminated[-1]
    assert np.any(ended) and np.array_equal(ended, ~np.any(after.recall, axis=(1, 2)))


@pytest.mark.parametrize("flown", [FRAMES], indirect=True, ids=["frames"])
def test_frames_are_the_last_observations_newest_first(flown):
    """By a slow loop over the rollout; before a fight's start stand zeros."""
    learn, learners, env, after, rollout = flown
    policy = policy_of(select(learners, ATTACKER))
    seen = np.asarray(scaled(learn, policy.observation_scaler, rollout.observation[:, :, ATTACKER]))
    for n in range(4):
        past = [*np.asarray(env.recall)[n, ATTACKER].reshape(-1, 35)]
        for step in range(learn.rollout_steps):
            now = rollout.recall[step, n, ATTACKER]
            assert np.array_equal(now, np.concatenate(past)), (n, step)
            inputs, _ = remember(policy, seen[step, n], now)
            assert np.array_equal(inputs, np.concatenate([seen[step, n], *past]))
            past = [seen[step, n], *past[:-1]]
            if rollout.terminated[step, n]:
                past = [np.zeros(35, np.float32)] * (STEPS - 1)
        assert np.array_equal(after.recall[n, ATTACKER], np.concatenate(past))


@pytest.mark.parametrize("agent", [DEFENDER, ATTACKER])
@pytest.mark.long
def test_before_the_first_step_the_new_policy_is_the_one_that_flew(flown, agent):
    """The ratio of every step is 1: an update with a rate of next to nothing measures no
    divergence and clips nothing, and what it learns from has the log-probabilities of the flight.
    """
    learn, learners, _, _, rollout = flown
    still = replace(learn, learning_rate_schedule="constant")
    learner = select(learners, agent).replace(learning_rate=jnp.float32(1e-12))
    update = jax.jit(
        lambda learner: update_learner(still, learner, rollout, agent, jax.random.key(0))
    )
    _, metrics = update(learner)
    assert abs(metrics.kl) < 1e-6 and metrics.clip_fraction == 0.0
    assert metrics.skipped == 0 and metrics.grad_norm > 0.0


@pytest.mark.long
def test_values_are_of_what_is_remembered(flown):
    """Against a slow loop over one environment, the policy's own steps deciding what it knows."""
    learn, learners, env, _, rollout = flown
    learner = select(learners, ATTACKER)
    policy = policy_of(learner)
    value, following = estimate_values(learn, learner, rollout, ATTACKER)
    for n in range(4):
        recall = env.recall[n, ATTACKER]
        for step in range(learn.rollout_steps):
            seen, final = (
                leaf[step, n, ATTACKER] for leaf in (rollout.observation, rollout.final_observation)
            )
            look = lambda seen, recall: remember(
                policy, scaled(learn, policy.observation_scaler, seen), recall
            )[0]
            worth = forward(learner.parameters.value, look(seen, recall))[0]
            assert value[step, n] == pytest.approx(float(worth), abs=1e-5)
            _, recall = policy_step(learn, policy, seen, recall)
            if rollout.terminated[step, n]:
                recall = jnp.zeros_like(recall)
            elif step == learn.rollout_steps - 1:
                worth = forward(learner.parameters.value, look(final, recall))[0]
                assert following[step, n] == pytest.approx(float(worth), abs=1e-5)


@pytest.mark.long
def test_a_policy_takes_what_it_needs_of_a_longer_memory():
    """Beside one that remembers more, in the same fights."""
    policy = policy_of(init_learner(jax.random.key(0), FRAMES))
    size = memory_size(policy)
    assert size == recall_size(Config(learn=FRAMES)) > 0
    seen, recall = jax.random.normal(jax.random.key(1), (5, 35)), jnp.ones((5, size))
    longer = jnp.concatenate([recall, 7.0 * jnp.ones((5, 3))], axis=1)
    mean, after = policy_step(FRAMES, policy, seen, recall)
    again, kept = policy_step(FRAMES, policy, seen, longer)
    assert kept is not None
    assert np.array_equal(mean, again) and np.array_equal(kept[:, :size], after)
    assert np.all(kept[:, size:] == 7.0)
    with pytest.raises(ValueError, match="remembers"):
        policy_step(FRAMES, policy, seen, None)
