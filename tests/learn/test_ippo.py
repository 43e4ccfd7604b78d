"""The learner on probe environments whose answer is known, and what an update must leave alone."""

from functools import partial
from types import SimpleNamespace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dronecombat_jax.config.fields import Config, LearnConfig, TrainConfig
from dronecombat_jax.learn.algorithms import learn_from
from dronecombat_jax.learn.ippo import estimate_values, init_learner
from dronecombat_jax.learn.networks import forward
from dronecombat_jax.learn.normalize import denormalize, init_scaler, update_scaler
from dronecombat_jax.learn.optimize import cut
from dronecombat_jax.learn.rollout import collect, policy_mean, policy_of, scaled, select
from dronecombat_jax.selfplay import tally
from dronecombat_jax.selfplay.pool import met
from dronecombat_jax.selfplay.summary import summarize
from dronecombat_jax.types import ATTACKER, DEFENDER, Batch, Cause, Learner

LEARN = LearnConfig(
    hidden_sizes=(16, 16),
    rollout_steps=8,
    epochs=4,
    minibatches=4,
    discount=0.9,
    learning_rate=3e-3,
    entropy_scale=0.0,
)
CONFIG = Config(learn=LEARN, train=TrainConfig(num_envs=32))
ITERATIONS = 50
BOTH = (True, True)
QUICK_TO_COMPILE = {"xla_backend_optimization_level": 1, "xla_llvm_disable_expensive_passes": True}


class Result(NamedTuple):
    """Learners and metrics after `ITERATIONS` iterations."""

    learners: Learner
    metrics: NamedTuple

    def value(self, agent: int, x: float, clock: int = 0) -> float:
        learner = select(self.learners, agent)
        normalized = forward(
            learner.parameters.value,
            scaled(LEARN, learner.observation_scaler, observation(x, clock)),
        )
        return float(denormalize(learner.value_scaler, normalized)[0])

    def action(self, agent: int, x: float) -> float:
        return float(policy_mean(LEARN, policy_of(select(self.learners, agent)), observation(x))[0])


def observation(x: float, clock: int = 0) -> jax.Array:
    return jnp.zeros(35).at[0].set(x).at[1].set(clock)


@pytest.fixture(scope="module")
def learn(make_probe, make_task):
    """Learn a task; one compiled program for all of them."""

    @partial(jax.jit, compiler_options=QUICK_TO_COMPILE)
    def program(task, learners, learning, seed):
        probe, key = make_probe(CONFIG, task), jax.random.key(seed)
        env = jax.vmap(probe.spawn)(
            probe.start_numbers(jax.random.fold_in(key, ITERATIONS), (CONFIG.train.num_envs,))
        )

        def one(carry, i):
            noise, spawn, shuffle = jax.random.split(jax.random.fold_in(key, i), 3)
            learners, env, flown = carry
            flying = policy_of(select(learners, DEFENDER)), policy_of(select(learners, ATTACKER))
            env, rollout = collect(probe, flying, env, noise, spawn)
            flown, at_each_step = tally.follow(flown, rollout, met(None, CONFIG.train.num_envs))
            learners, metrics = learn_from(CONFIG.learn, learners, rollout, shuffle, learning)
            return (learners, env, flown), summarize(CONFIG, rollout, at_each_step, metrics, None)

        start = learners, env, tally.fresh(CONFIG.train.num_envs, 2)
        (learners, *_), metrics = jax.lax.scan(one, start, jnp.arange(ITERATIONS))
        return learners, metrics

    def run(learners=None, learning=BOTH, seed=0, **task) -> Result:
        learners = untrained() if learners is None else learners
        return Result(*program(make_task(**task), learners, jnp.asarray(learning), seed))

    return run


def untrained() -> Learner:
    return jax.vmap(lambda key: init_learner(key, LEARN))(jax.random.split(jax.random.key(1)))


def assert_same_bits(a: Learner, b: Learner) -> None:
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert np.asarray(x).tobytes() == np.asarray(y).tobytes()


@pytest.mark.long
def test_constant_reward(learn):
    result = learn(constant=(1.0, -3.0))
    for x in (-1.0, 1.0):
        assert result.value(DEFENDER, x) == pytest.approx(1.0, abs=0.05)
        assert result.value(ATTACKER, x) == pytest.approx(-3.0, abs=0.05)


@pytest.mark.long
def test_reward_that_depends_on_the_observation(learn):
    result = learn(sign=(1.0, -2.0), constant=(0.0, 5.0))
    for x in (-1.0, 1.0):
        assert result.value(DEFENDER, x) == pytest.approx(x, abs=0.1)
        assert result.value(ATTACKER, x) == pytest.approx(5.0 - 2.0 * x, abs=0.2)
    assert np.all(result.metrics.learners.explained_variance[-1] > 0.9)


def test_reward_that_comes_later_is_discounted(learn):
    result = learn(last=(1.0, -1.0), length=3)
    for agent, sign in ((DEFENDER, 1.0), (ATTACKER, -1.0)):
        for clock, expected in enumerate((0.81, 0.9, 1.0)):
            assert sign * result.value(agent, 1.0, clock) == pytest.approx(expected, abs=0.07), (
                clock
            )


def test_what_comes_after_a_crash_is_part_of_the_crashs_worth(learn):
    """The drones fly for three steps, lie there for three, and the last step pays 1 or -1."""
    result = learn(last=(1.0, -1.0), length=6, flies=3)
    for agent, sign in ((DEFENDER, 1.0), (ATTACKER, -1.0)):
        for clock in range(6):
            assert sign * result.value(agent, 1.0, clock) == pytest.approx(
                0.9 ** (5 - clock), abs=0.08
            ), clock


def test_a_time_out_is_worth_the_value_of_its_final_observation(learn):
    # one reward a step for ever: 1 / (1 - 0.9) = 10, though every fight is cut after two steps
    endless = learn(constant=1.0, length=2, truncates=True)
    endless = learn(learners=endless.learners, constant=1.0, length=2, truncates=True, seed=1)
    decided = learn(constant=1.0, length=2)
    for agent in (DEFENDER, ATTACKER):
        assert endless.value(agent, 1.0) == pytest.approx(10.0, abs=1.0)
        assert decided.value(agent, 1.0) == pytest.approx(1.9, abs=0.1)  # 1 + 0.9


def test_reward_that_depends_on_the_action(learn):
    result = learn(effort=1.0, centre=(0.5, -0.5))
    for x in (-1.0, 1.0):
        assert result.action(DEFENDER, x) == pytest.approx(0.5, abs=0.15)
        assert result.action(ATTACKER, x) == pytest.approx(-0.5, abs=0.15)
    # and the noise, which costs, has gone down
    assert np.all(result.learners.parameters.log_std[:, 0] < -0.5)


def test_reward_that_depends_on_action_and_observation(learn):
    result = learn(effort=1.0, slope=(0.7, -0.7))
    for x in (-1.0, 1.0):
        assert result.action(DEFENDER, x) == pytest.approx(0.7 * x, abs=0.2)
        assert result.action(ATTACKER, x) == pytest.approx(-0.7 * x, abs=0.2)


@pytest.mark.parametrize("agent", [DEFENDER, ATTACKER])
def test_one_agents_reward_does_not_touch_the_other(learn, agent):
    rewards = [3.0, 3.0]
    first = learn(effort=1.0, constant=rewards)
    rewards[1 - agent] = -200.0
    second = learn(effort=1.0, constant=rewards)
    assert_same_bits(select(first.learners, agent), select(second.learners, agent))
    changed = [select(result.learners, 1 - agent).value_scaler.mean for result in (first, second)]
    assert changed[0] != changed[1]


@pytest.mark.parametrize(
    "learning", [(False, True), (True, False)], ids=["attacker alone", "defender alone"]
)
def test_an_agent_that_does_not_learn_keeps_every_bit(learn, learning):
    start = untrained()
    result = learn(effort=1.0, sign=1.0, learning=learning)
    agent = learning.index(False)
    assert_same_bits(select(result.learners, agent), select(start, agent))
    assert_same_bits(
        select(result.learners, 1 - agent), select(learn(effort=1.0, sign=1.0).learners, 1 - agent)
    )


@pytest.mark.parametrize("reward", [np.nan, np.inf, -np.inf])
def test_a_reward_that_is_not_finite_costs_the_update_and_nothing_else(learn, reward):
    start = untrained()
    result = learn(effort=1.0, constant=(reward, 1.0))
    broken = select(result.learners, DEFENDER)
    for name in ("parameters", "optimizer", "learning_rate"):
        # no divergence: the rate must not climb either
        assert_same_bits(getattr(broken, name), getattr(select(start, DEFENDER), name))
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(result.learners))
    skipped = result.metrics.learners.skipped
    assert skipped[:, DEFENDER].tolist() == [LEARN.epochs * LEARN.minibatches] * ITERATIONS
    assert not np.any(skipped[:, ATTACKER])
    assert_same_bits(
        select(result.learners, ATTACKER),
        select(learn(effort=1.0, constant=1.0).learners, ATTACKER),
    )
    recovered = learn(learners=result.learners, sign=1.0, seed=1)
    assert recovered.value(DEFENDER, 1.0) == pytest.approx(1.0, abs=0.1)


def test_what_an_iteration_reports(learn):
    result = learn(constant=(1.0, -3.0), length=3, learning=(True, False))
    causes = np.asarray(result.metrics.causes)
    # 8 steps of fights of 3: 2 end in the first rollout, then 3, 3, 2, 3, 3, ... of 32 each
    assert causes[:4, Cause.REACHED].tolist() == [64, 96, 96, 64]
    assert causes.sum() == causes[:, Cause.REACHED].sum()
    assert np.array_equal(result.metrics.episode_steps, 3 * causes.sum(1))
    np.testing.assert_allclose(
        result.metrics.returns, causes.sum(1)[:, None] * [[3.0, -9.0]], rtol=1e-5
    )
    np.testing.assert_allclose(
        result.metrics.reward_terms.approach, [[1.0, -3.0]] * ITERATIONS, rtol=1e-6
    )
    learning_rate = np.asarray(result.metrics.learners.learning_rate)
    assert (
        np.all(learning_rate[:, DEFENDER] > 0)
        and result.learners.learning_rate[DEFENDER] == learning_rate[-1, 0]
    )


def test_minibatches_are_contiguous_in_time_or_shuffled_without_loss():
    flat = Batch(*(jnp.arange(12.0) + 100 * i for i in range(len(Batch._fields))))
    key = jax.random.key(0)
    sequential = cut(LearnConfig(minibatches=3), flat, key)
    assert sequential.log_prob.tolist() == (200 + np.arange(12.0).reshape(3, 4)).tolist()
    shuffled = cut(LearnConfig(minibatches=3, minibatch_order="shuffled"), flat, key)
    assert (
        shuffled.value.shape == (3, 4)
        and sorted(shuffled.value.reshape(-1).tolist()) == flat.value.tolist()
    )
    assert shuffled.value.tolist() != (400 + np.arange(12.0).reshape(3, 4)).tolist()
    # rows stay together
    assert np.array_equal(shuffled.target - shuffled.observation, np.full((3, 4), 500.0))
    other = cut(LearnConfig(minibatches=3, minibatch_order="shuffled"), flat, jax.random.key(1))
    assert other.value.tolist() != shuffled.value.tolist()


@pytest.mark.parametrize("bootstrap", [True, False])
@pytest.mark.long
def test_values_of_successors(bootstrap):
    """Against a slow loop: the next step's value, the final observation's where a step was
    truncated.
    """
    learn = LearnConfig(hidden_sizes=(8,), bootstrap_timeout=bootstrap)
    learner = init_learner(jax.random.key(0), learn)
    rng = np.random.default_rng(0)
    learner = learner.replace(
        value_scaler=update_scaler(
            init_scaler(()), jnp.asarray(rng.normal(size=50) * 20 + 9), jnp.ones(50)
        )
    )
    now, final = (jnp.asarray(rng.normal(size=(6, 3, 2, 35)), jnp.float32) for _ in range(2))
    truncated = jnp.asarray(rng.random((6, 3)) < 0.3).at[2].set(False)
    rollout = SimpleNamespace(
        observation=now, final_observation=final, truncated=truncated, recall=None
    )

    def worth(row: jax.Array) -> float:
        return float(
            denormalize(
                learner.value_scaler, forward(learner.parameters.value, jnp.clip(row, -5, 5))[0]
            )
        )

    value, following = estimate_values(learn, learner, rollout, ATTACKER)  # pyright: ignore[reportArgumentType]
    for t in range(6):
        for n in range(3):
            assert value[t, n] == pytest.approx(worth(now[t, n, ATTACKER]), rel=1e-5, abs=1e-4)
            cut_off = t == 5 or (bootstrap and truncated[t, n])
            after = final[t, n, ATTACKER] if cut_off else now[t + 1, n, ATTACKER]
            assert following[t, n] == pytest.approx(worth(after), rel=1e-5, abs=1e-4)
