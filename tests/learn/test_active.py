"""A drone's steps count for its own learning exactly while its actions have an effect (SPEC of the
weights: MAPPO's masks).
"""

from dataclasses import replace
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy import CONFIG, UNOPTIMISED, Coasting, assert_same_bits, differs

from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.learn import ppo
from dronecombat_jax.learn.algorithms import learn_from
from dronecombat_jax.learn.ippo import init_learner, step_weights
from dronecombat_jax.learn.normalize import init_scaler, update_scaler
from dronecombat_jax.learn.rollout import collect, policy_of, select
from dronecombat_jax.selfplay.chunk import reset_fights
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause, Learner, Transition, UpdateMetrics


class Updated(NamedTuple):
    """Both agents after an update."""

    learners: Learner
    metrics: UpdateMetrics


LEARN = replace(CONFIG.learn, minibatch_order="sequential", learning_rate=3e-3)


@pytest.fixture(scope="module", params=["out", pytest.param("grounded", marks=pytest.mark.slow)])
def rollout(request) -> Transition:
    """Toy fights in which drones go down and the fight goes on."""
    return flown(LEARN, request.param)


def flown(learn: LearnConfig, crash_rule: Literal["out", "grounded"]) -> Transition:
    config = replace(CONFIG, learn=learn, game=replace(CONFIG.game, crash_rule=crash_rule))
    combat, key = Coasting(config), jax.random.key(0)

    def fly() -> Transition:
        learners = untrained()
        policies = policy_of(select(learners, DEFENDER)), policy_of(select(learners, ATTACKER))
        fights = reset_fights(combat, jnp.uint32(0), jnp.int32(0))
        for turn in range(2):
            fights, _ = collect(combat, policies, fights, jax.random.fold_in(key, turn), key)
        return collect(combat, policies, fights, jax.random.fold_in(key, 2), key)[1]

    return jax.jit(fly, compiler_options=UNOPTIMISED)()


def untrained():
    return jax.vmap(lambda key: init_learner(key, LEARN))(jax.random.split(jax.random.key(1)))


@pytest.fixture(scope="module")
def update():
    """Both agents' update from a rollout, by `inactive_steps`."""
    programs = {}

    def run(rollout: Transition, inactive_steps: str = "value"):
        learn = replace(LEARN, inactive_steps=inactive_steps)
        both, key = jnp.ones(2, bool), jax.random.key(2)
        if inactive_steps not in programs:
            program = lambda learners, rollout: learn_from(learn, learners, rollout, key, both)
            programs[inactive_steps] = jax.jit(program, compiler_options=UNOPTIMISED)
        learners, metrics = programs[inactive_steps](untrained(), rollout)
        return Updated(learners, metrics)

    return run


def redrawn(rollout: Transition, where: np.ndarray) -> Transition:
    """Other actions and log-probabilities `where` [T, N, A]."""
    noise = 3.0 * jax.random.normal(jax.random.key(9), rollout.action.shape)
    return rollout._replace(
        action=jnp.where(where[..., None], noise, rollout.action),
        log_prob=jnp.where(where, -5.0, rollout.log_prob),
    )


@pytest.mark.long
def test_what_a_drone_did_while_it_was_down_changes_nothing(rollout, update):
    idle = np.asarray(rollout.idle)
    assert 0.2 < idle[..., DEFENDER].mean() < 0.95
    before, after = update(rollout), update(redrawn(rollout, idle))
    assert_same_bits(before, after)
    flying = update(redrawn(rollout, np.asarray(rollout.active)))  # and this would be seen
    assert differs(before.learners.parameters, flying.learners.parameters)


def test_the_step_of_a_crash_counts_and_the_next_does_not(rollout):
    down, active, idle = (np.asarray(leaf) for leaf in (rollout.down, rollout.active, rollout.idle))
    ends = np.asarray(rollout.terminated | rollout.truncated)[..., None]
    crashes = down[1:] & ~down[:-1] & ~ends[:-1]
    assert crashes.any() and np.all(active[1:][crashes])
    lying = down[:-1] & ~ends[:-1]
    assert np.all(idle[1:][lying]) and not np.any(active[1:][lying])
    assert np.all(active ^ idle)  # no fault in here: one or the other


@pytest.mark.long
def test_with_none_not_even_what_it_saw_there_counts_and_with_all_everything_does(rollout, update):
    """The returns of steps in flight contain what was earned later: that, and the values
    bootstrapped from, stay.
    """
    idle = np.asarray(rollout.idle)
    weights = {
        name: [
            np.asarray(weight)
            for weight in step_weights(replace(LEARN, inactive_steps=name), rollout, DEFENDER)
        ]
        for name in ("value", "none", "all")
    }
    mine = idle[..., DEFENDER]
    for name, (policy, value) in {"value": (0, 1), "none": (0, 0), "all": (1, 1)}.items():
        assert np.all(weights[name][0][mine] == policy) and np.all(
            weights[name][1][mine] == value
        ), name
        assert np.all(weights[name][0][~mine] == 1) and np.all(weights[name][1][~mine] == 1), name
    assert differs(update(rollout, "all"), update(redrawn(rollout, idle), "all"))
    shares = [update(rollout, name).metrics.active_share for name in ("value", "none", "all")]
    flying = 1.0 - idle.mean((0, 1))
    np.testing.assert_allclose(
        np.asarray(shares), np.stack([flying, flying, np.ones(2)]), rtol=1e-6
    )


@pytest.mark.long
def test_observation_statistics_are_of_steps_in_flight(rollout, update):
    seen = np.asarray(rollout.observation, np.float64)[:, :, DEFENDER][
        np.asarray(rollout.active)[..., DEFENDER]
    ]
    scaler = select(update(rollout).learners, DEFENDER).observation_scaler
    n = len(seen)
    assert float(scaler.count) == 1 + n
    # one earlier sample at 0
    np.testing.assert_allclose(scaler.mean, seen.sum(0) / (1 + n), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("poison", [np.nan, np.inf, 1e30])
def test_an_action_that_is_not_finite_leaves_the_rest_of_the_update_alone(rollout, update, poison):
    """The fight ends with it, so nothing before or after it in the rollout depends on it."""
    active = np.asarray(rollout.active).copy()
    step = (1, 2)
    ends = rollout.terminated.at[step].set(True)
    cause = rollout.cause.at[step].set(Cause.ATTACKER_INVALID)
    active[(*step, ATTACKER)] = False
    idle = np.asarray(rollout.idle).copy()
    idle[(*step, ATTACKER)] = False
    healthy = rollout._replace(
        terminated=ends, cause=cause, active=jnp.asarray(active), idle=jnp.asarray(idle)
    )
    action = healthy.action.at[(*step, ATTACKER)].set(poison)
    log_prob = healthy.log_prob.at[(*step, ATTACKER)].set(-poison)
    broken = update(healthy._replace(action=action, log_prob=log_prob))
    assert_same_bits(broken, update(healthy))
    assert not np.any(broken.metrics.skipped)


def test_an_agent_without_a_step_that_counts_keeps_its_parameters(rollout, update):
    nothing = rollout._replace(
        active=jnp.zeros_like(rollout.active), idle=jnp.zeros_like(rollout.idle)
    )
    after = update(nothing)
    start = untrained()
    for name in ("parameters", "optimizer", "learning_rate", "observation_scaler", "value_scaler"):
        assert_same_bits(getattr(after.learners, name), getattr(start, name))
    assert not np.any(after.metrics.skipped)


def test_weighted_mathematics_is_that_of_the_steps_that_count():
    """Leaving steps out by weight is leaving them out."""
    rng = np.random.default_rng(0)
    x, y, z = (jnp.asarray(rng.normal(size=40), jnp.float32) for _ in range(3))
    weight = jnp.asarray(rng.random(40) < 0.4, jnp.float32)
    kept = np.flatnonzero(weight)
    ones = jnp.ones(len(kept))
    pairs = {
        "policy": lambda x, y, z, w: ppo.policy_loss(0.3 * x, y, w, 0.2),
        "value": lambda x, y, z, w: ppo.value_loss(x, y, z, w, 0.2, "skrl"),
        "kl": lambda x, y, z, w: ppo.approximate_kl(x, w),
        "explained": lambda x, y, z, w: ppo.explained_variance(x, y, w),
    }
    for name, function in pairs.items():
        expected = function(x[kept], y[kept], z[kept], ones)
        np.testing.assert_allclose(function(x, y, z, weight), expected, rtol=1e-5, err_msg=name)
    normal = ppo.normalize_advantages(x, weight)
    np.testing.assert_allclose(
        normal[kept], ppo.normalize_advantages(x[kept], ones), rtol=1e-5, atol=1e-6
    )
    assert not np.any(np.delete(np.asarray(normal), kept))
    scaler, few = (
        update_scaler(init_scaler(()), x, weight),
        update_scaler(init_scaler(()), x[kept], ones),
    )
    np.testing.assert_allclose(jax.tree.leaves(scaler), jax.tree.leaves(few), rtol=1e-5)
    assert_same_bits(update_scaler(scaler, x, 0.0 * weight), scaler)  # an empty batch


@pytest.mark.long
def test_a_log_std_at_its_floor_leaves_it_when_more_noise_pays(rollout):
    """A clip in the loss has no gradient below the floor: the parameter stayed there for ever."""
    learn = replace(
        LEARN,
        min_log_std=-0.5,
        initial_log_std=-0.5,
        entropy_scale=10.0,
        learning_rate_schedule="constant",
    )
    start = jax.vmap(lambda key: init_learner(key, learn))(jax.random.split(jax.random.key(1)))
    below = start.parameters.log_std - 0.01
    learn_below = start.replace(parameters=start.parameters.replace(log_std=below))
    program = jax.jit(
        lambda learners: learn_from(learn, learners, rollout, jax.random.key(2), jnp.ones(2, bool))[
            0
        ],
        compiler_options=UNOPTIMISED,
    )
    for learners in (start, learn_below):
        after = program(learners).parameters.log_std
        assert np.all(after > -0.5)
    falling = replace(learn, entropy_scale=-10.0)  # noise costs: the floor holds, exactly
    push = jax.jit(
        lambda learners: learn_from(
            falling, learners, rollout, jax.random.key(2), jnp.ones(2, bool)
        )[0],
        compiler_options=UNOPTIMISED,
    )
    assert np.all(push(start).parameters.log_std == -0.5)


@pytest.mark.long
def test_progress_is_learnt_from_as_reward_is(rollout, update):
    gained = jax.random.normal(jax.random.key(4), rollout.reward.shape)
    beside = update(rollout._replace(progress=gained))
    within = update(rollout._replace(reward=rollout.reward + gained))
    assert_same_bits(beside.learners, within.learners)
    assert differs(beside.learners, update(rollout).learners)


@pytest.mark.long
def test_progress_stands_beside_the_reward_and_only_for_who_flies():
    plain = flown(LEARN, "out")
    rewarded = flown(replace(LEARN, defender_progress=30.0, attacker_progress=7.0), "out")
    assert plain.progress is None and rewarded.progress is not None
    assert_same_bits(rewarded._replace(progress=None), plain)
    assert np.any(rewarded.progress, axis=(0, 1)).all()
    assert not np.any(np.asarray(rewarded.progress)[~np.asarray(rewarded.active)])
