"""A teacher: what a scripted pilot would do, and a policy that is drawn to it."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy import CONFIG, UNOPTIMISED, Coasting, assert_same_bits, differs

from dronecombat_jax.combat.scripted import build_pilot
from dronecombat_jax.config.fields import Config, LearnConfig, RunConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.learn import ppo
from dronecombat_jax.learn.algorithms import learn_from
from dronecombat_jax.learn.ippo import init_learner
from dronecombat_jax.learn.rollout import collect, policy_mean, policy_of, select, teaching
from dronecombat_jax.runs import training
from dronecombat_jax.selfplay.chunk import reset_fights
from dronecombat_jax.types import ATTACKER, DEFENDER

PLAIN = replace(CONFIG.learn, minibatch_order="sequential", learning_rate=3e-3)
TAUGHT = replace(PLAIN, defender_teacher="goalkeeper", teacher_scale=100.0)


def toy(learn: LearnConfig) -> Coasting:
    return Coasting(replace(CONFIG, learn=learn))


def untrained(learn: LearnConfig):
    return jax.vmap(lambda key: init_learner(key, learn))(jax.random.split(jax.random.key(1)))


def flown(learn: LearnConfig):
    """The fights at the start, and a rollout of untrained policies."""
    combat, key = toy(learn), jax.random.key(0)

    def fly():
        learners = untrained(learn)
        policies = tuple(policy_of(select(learners, side)) for side in (DEFENDER, ATTACKER))
        fights = reset_fights(combat, jnp.uint32(0), jnp.int32(0))
        return fights, collect(combat, policies, fights, key, key)[1]

    return jax.jit(fly, compiler_options=UNOPTIMISED)()


@pytest.fixture(scope="module")
def lessons():
    return flown(TAUGHT)


def test_a_lesson_is_what_the_scripted_pilot_would_do(lessons):
    fights, rollout = lessons
    pilot = build_pilot("goalkeeper", CONFIG, toy(TAUGHT).scene, DEFENDER)
    wanted = jnp.clip(pilot(fights, rollout.observation[0], jax.random.key(0)), -1.0, 1.0)
    assert np.any(np.asarray(wanted) != 0.0)
    np.testing.assert_allclose(rollout.lesson[0, :, DEFENDER], wanted, atol=1e-5)
    assert not np.any(rollout.lesson[:, :, ATTACKER])


@pytest.mark.long
def test_a_rollout_is_otherwise_the_same_and_without_a_teacher_there_is_no_lesson(lessons):
    _, plain = flown(PLAIN)
    assert plain.lesson is None
    assert_same_bits(lessons[1]._replace(lesson=None), plain)


@pytest.mark.long
def test_the_policy_comes_nearer_to_its_teacher_and_the_other_side_learns_as_before(lessons):
    _, rollout = lessons

    def learnt(learn: LearnConfig):
        update = lambda learners: learn_from(
            learn, learners, rollout, jax.random.key(2), jnp.ones(2, bool)
        )[0]
        return jax.jit(update, compiler_options=UNOPTIMISED)(untrained(learn))

    def away(learners) -> float:
        """From the lessons, over the steps that the policy learns from; the scaler moves as well."""
        start = policy_of(select(untrained(TAUGHT), DEFENDER)).observation_scaler
        policy = policy_of(select(learners, DEFENDER)).replace(observation_scaler=start)
        mean = policy_mean(TAUGHT, policy, rollout.observation[:, :, DEFENDER])
        gap = np.sum(np.square(mean - rollout.lesson[:, :, DEFENDER]), axis=-1)
        return float(np.mean(gap[np.asarray(rollout.active[:, :, DEFENDER])]))

    taught, plain = learnt(TAUGHT), learnt(PLAIN)
    assert away(taught) < 0.9 * away(plain) and away(taught) < away(untrained(TAUGHT))
    assert_same_bits(select(taught, ATTACKER), select(plain, ATTACKER))
    nothing = learnt(replace(TAUGHT, teacher_scale=0.0))
    assert_same_bits(nothing, plain)
    assert differs(taught, plain)


def test_the_loss_is_half_the_squared_distance_over_the_steps_that_count():
    # (1 + 4) / 2 = 2.5 and (9 + 9) / 2 = 9: with weights 1 and 0 the first alone
    mean = jnp.asarray([[1.0, 3.0], [0.0, 0.0], [0.0, -3.0], [2.0, 0.0]])
    lesson = jnp.zeros((4, 2))
    assert ppo.teacher_loss(mean, lesson, jnp.asarray([1.0, 0.0])) == pytest.approx(2.5)
    assert ppo.teacher_loss(mean, lesson, jnp.ones(2)) == pytest.approx((2.5 + 9.0) / 2)


@pytest.mark.parametrize("name", ["nobody", "dash"])  # dash attacks
def test_a_teacher_that_is_no_scripted_defender_is_one_line(name):
    with pytest.raises(UserError, match=f"^learn.defender_teacher {name}: ") as error:
        teaching(toy(replace(PLAIN, defender_teacher=name)))
    assert "goalkeeper" in error.value.message and "\n" not in error.value.message


def test_it_is_said_before_a_run_has_a_folder(tmp_path):
    run = RunConfig(directory=str(tmp_path / "runs"), name="taught")
    with pytest.raises(UserError, match=r"^learn.defender_teacher nobody: "):
        training.train(Config(learn=replace(PLAIN, defender_teacher="nobody"), run=run))
    assert not (tmp_path / "runs").exists()
