"""The brax view: what it shows is the game's own step, how fights end and begin in it, and brax
learns through it.
"""

import functools
from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy import UNOPTIMISED, Coasting

from dronecombat_jax.errors import UserError
from dronecombat_jax.machine import backend
from dronecombat_jax.types import ATTACKER, DEFENDER, EnvState

backend.import_mjx()  # brax imports it, and lets it print to stdout

from brax.envs.base import Env, State  # noqa: E402
from brax.envs.wrappers.training import AutoResetWrapper, EpisodeWrapper, EvalWrapper, VmapWrapper  # noqa: E402
from brax_views import HOLD, LENGTH, SIZE, hold, make, wander  # noqa: E402

from dronecombat_jax.adapters.brax_env import CombatEnv, wrap  # noqa: E402
from dronecombat_jax.config.fields import Config, GameConfig, TrainConfig  # noqa: E402


def keys(seed: int = 0) -> jax.Array:
    return jax.random.split(jax.random.PRNGKey(seed), SIZE)


def jitted(env: Env, traces: list | None = None) -> SimpleNamespace:
    """`reset(keys)` and `step(state, action)` of wrapped environments, compiled without
    optimisation.
    """

    def step(state: State, action: jax.Array) -> State:
        if traces is not None:
            traces.append(action.shape)
        return env.step(state, action)

    compiled = functools.partial(jax.jit, compiler_options=UNOPTIMISED)
    return SimpleNamespace(reset=compiled(env.reset), step=compiled(step))


@pytest.fixture(scope="module")
def wrapped() -> SimpleNamespace:
    traces = []
    return SimpleNamespace(**vars(jitted(wrap(make(), LENGTH), traces)), traces=traces)


def place(state: State, fight: int, **leaves) -> State:
    """The state with the leaves of one fight changed."""
    old = state.pipeline_state
    assert isinstance(old, EnvState)
    new = {name: getattr(old, name).at[fight].set(value) for name, value in leaves.items()}
    return replace(state, pipeline_state=old.replace(**new))


ACTION = jnp.tile(HOLD, (SIZE, 1))
OTHERS = np.arange(SIZE) != 3


@pytest.mark.parametrize("role", [DEFENDER, ATTACKER])
def test_keeps_to_braxs_protocol(role: int):
    env = make(role)
    assert isinstance(env, Env) and env.unwrapped is env and env.backend == "mjx"
    start = jax.eval_shape(env.reset, jax.random.PRNGKey(0))
    after = jax.eval_shape(env.step, start, jnp.zeros(env.action_size))
    described = lambda tree: jax.tree.map(lambda leaf: (leaf.shape, leaf.dtype.name), tree)
    assert isinstance(start, State) and described(start) == described(after)
    assert described((start.obs, start.reward, start.done)) == (
        ((env.observation_size,), "float32"), ((), "float32"), ((), "float32"),
    )  # fmt: skip
    # A weak type in what is carried compiles every program twice.
    assert not [leaf for leaf in jax.tree.leaves((start, after)) if leaf.weak_type]


def test_a_key_of_either_style_gives_the_same_fight():
    env, key = make(), jax.random.key(5)
    jax.tree.map(np.testing.assert_array_equal, env.reset(key), env.reset(jax.random.key_data(key)))


@pytest.mark.parametrize("wrapper", [wrap, functools.partial(wrap, mask_time_outs=False)])
@pytest.mark.long
def test_wrapped_fights_begin_and_go_on_alike_from_keys_of_either_style(wrapper):
    batch, typed = (
        jitted(EvalWrapper(wrapper(make(), LENGTH))),
        jax.random.split(jax.random.key(0), SIZE),
    )
    flown = [
        batch.step(batch.reset(style), ACTION) for style in (typed, jax.random.key_data(typed))
    ]
    jax.tree.map(np.testing.assert_array_equal, *flown)
    assert flown[0].info["steps"].tolist() == [1.0] * SIZE and flown[0].info[
        "truncation"
    ].shape == (SIZE,)


def test_one_fight_in_braxs_own_wrappers_takes_keys_of_either_style():
    alone, typed = jitted(AutoResetWrapper(EpisodeWrapper(make(), LENGTH, 1))), jax.random.key(0)
    flown = [alone.step(alone.reset(style), HOLD) for style in (typed, jax.random.key_data(typed))]
    jax.tree.map(np.testing.assert_array_equal, *flown)
    assert flown[0].info["steps"].shape == ()


@pytest.mark.parametrize("observation", ["world", pytest.param("ego", marks=pytest.mark.slow)])
@pytest.mark.parametrize("role", [DEFENDER, ATTACKER])
@pytest.mark.long
def test_a_step_is_the_games_own_for_that_role(role: int, observation: str):
    env = make(role, wander, observation=observation)
    combat, batch = env.combat, jitted(VmapWrapper(env))
    game_step = jax.jit(jax.vmap(combat.step), compiler_options=UNOPTIMISED)
    state, random, ended, ran_out = batch.reset(keys()), np.random.default_rng(0), 0, 0
    for _ in range(LENGTH):
        action = random.normal(size=(SIZE, 4)).astype(np.float32)
        both = np.zeros((SIZE, 2, 4), np.float32)
        both[:, role] = action
        for i in range(SIZE):
            # the opponent, one fight after the other, by the key that the environment says
            fight = jax.tree.map(lambda leaf, i=i: leaf[i : i + 1], state.pipeline_state)
            key = jax.random.split(jax.random.wrap_key_data(state.info["key"][i]))[1]
            both[i, 1 - role] = wander(fight, jax.vmap(combat.observe)(fight), key)[0]
        after, output = game_step(state.pipeline_state, both)
        state = batch.step(state, action)
        np.testing.assert_allclose(state.reward, output.reward[:, role], rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(state.obs, output.observation[:, role], rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(state.pipeline_state.qpos, after.qpos, rtol=1e-5, atol=1e-5)
        np.testing.assert_array_equal(state.done, output.terminated | output.truncated)
        np.testing.assert_array_equal(state.info["time_out"], output.truncated)
        ended += np.sum(output.terminated)
        ran_out += np.sum(output.truncated)
    assert ended > 0 and ran_out > 0


def test_the_opponents_draws_differ_between_steps_and_fights():
    drawn = lambda state, observation, key: jax.random.normal(key, (1, 4))
    batch = jitted(VmapWrapper(make(opponent=drawn)))
    first = batch.step(batch.reset(keys()), ACTION)
    pushes = np.stack([first.pipeline_state.qvel, batch.step(first, ACTION).pipeline_state.qvel])[
        :, :, 0
    ]
    pushes[1] -= pushes[0]
    assert len(np.unique(pushes)) == 2 * SIZE


def test_time_running_out_truncates(wrapped: SimpleNamespace):
    state = wrapped.step(place(wrapped.reset(keys()), 3, clock=LENGTH - 1), ACTION)
    for name, expected in (("done", 1), ("draw", 1), ("win", 0), ("loss", 0)):
        value = state.done if name == "done" else state.metrics[name]
        np.testing.assert_array_equal(value, np.where(OTHERS, 0, expected), name)
    np.testing.assert_array_equal(state.info["truncation"], ~OTHERS)
    np.testing.assert_array_equal(state.info["time_out"], ~OTHERS)


@pytest.mark.parametrize(("drone", "outcome"), [(slice(7, 10), "win"), (slice(0, 3), "loss")])
def test_a_decision_terminates(wrapped: SimpleNamespace, drone: slice, outcome: str):
    """The attacker stands in the target, or the defender in the attacker; on the last step, when
    time runs out too.
    """
    state = wrapped.reset(keys())
    there = (
        state.pipeline_state.target[3] if outcome == "win" else state.pipeline_state.qpos[3, 7:10]
    )
    qpos = state.pipeline_state.qpos[3].at[drone].set(there)
    state = wrapped.step(place(state, 3, qpos=qpos, clock=LENGTH - 1), ACTION)
    np.testing.assert_array_equal(state.done, ~OTHERS)
    np.testing.assert_array_equal(state.metrics[outcome], ~OTHERS)
    assert not np.any(state.info["truncation"]) and not np.any(state.info["time_out"])
    assert state.reward[3] == pytest.approx(300.0 if outcome == "win" else -300.0, abs=2.0)


@pytest.mark.long
def test_a_time_out_that_decides_terminates():
    batch = jitted(wrap(make(DEFENDER, timeout_rule="defender"), LENGTH))
    state = batch.step(place(batch.reset(keys()), 3, clock=LENGTH - 1), ACTION)
    np.testing.assert_array_equal(state.done, ~OTHERS)
    np.testing.assert_array_equal(state.metrics["win"], ~OTHERS)
    assert not np.any(state.info["truncation"])


def test_a_time_out_to_bootstrap_from_is_not_masked():
    batch = jitted(wrap(make(), LENGTH, mask_time_outs=False))
    state = batch.step(place(batch.reset(keys()), 3, clock=LENGTH - 1), ACTION)
    np.testing.assert_array_equal(state.info["time_out"], ~OTHERS)
    np.testing.assert_array_equal(state.done, ~OTHERS)
    assert not np.any(state.info["truncation"])


def test_an_episode_length_below_the_games_truncates():
    batch = jitted(wrap(make(), 1))
    state = batch.step(batch.reset(keys()), ACTION)
    assert (
        np.all(state.done == 1)
        and np.all(state.info["truncation"] == 1)
        and not np.any(state.info["time_out"])
    )
    assert np.all(state.pipeline_state.clock == 0)


def test_an_end_is_followed_by_a_fresh_start_and_keeps_its_final_observation(
    wrapped: SimpleNamespace,
):
    game_step = jax.jit(jax.vmap(make().combat.step), compiler_options=UNOPTIMISED)
    start = wrapped.reset(keys())
    state, starts = start, []
    for _ in range(3):
        before = place(state, 3, clock=LENGTH - 1)
        state = wrapped.step(before, ACTION)
        flown_to, flown = game_step(before.pipeline_state, jnp.stack([ACTION, ACTION], axis=1))
        np.testing.assert_allclose(
            state.info["final_observation"], flown.observation[:, ATTACKER], atol=1e-5
        )
        np.testing.assert_allclose(
            state.obs[OTHERS], flown.observation[OTHERS, ATTACKER], atol=1e-5
        )
        np.testing.assert_array_equal(
            state.pipeline_state.clock, np.where(OTHERS, flown_to.clock, 0)
        )
        # The positions of eq. 5: p_d, p_a, p_t.
        places = np.stack([state.obs[3, 0:3], state.obs[3, 7:10], state.obs[3, 14:17]])
        np.testing.assert_array_equal(places[:, :2], [[0, 5], [0, 0], [5, 5]])
        starts.append(tuple(places[:, 2]))
    first = start.obs[:, [2, 9, 16]]
    # brax's own wrapper starts where it first did
    assert len({*starts, *map(tuple, np.asarray(first))}) == SIZE + 3
    assert np.asarray(wrapped.step(state, ACTION).info["steps"]).tolist() == [
        1 if i == 3 else 4 for i in range(SIZE)
    ]


@pytest.mark.long
def test_exploring_fights_begin_in_motion():
    combat = Coasting(Config(game=GameConfig(episode_steps=1), train=TrainConfig(start_speed=4.0)))
    batch = jitted(wrap(CombatEnv(combat, ATTACKER, hold, exploring=True), 1))
    state = batch.reset(keys())
    for _ in range(2):
        fastest = np.abs(state.pipeline_state.qvel).max(axis=0).reshape(2, 6)
        assert np.all(fastest[:, :2] > 1.0) and not np.any(fastest[:, 2:])
        state = batch.step(state, ACTION)


def test_steps_are_traced_once(wrapped: SimpleNamespace):
    state = wrapped.reset(keys(1))
    for _ in range(3):
        state = wrapped.step(state, ACTION)
    assert wrapped.traces == [(SIZE, 4)]  # by the other tests as well


def test_alone_the_attacker_meets_nobody():
    env = make(opponent=None, scenario="solo")
    batch = jitted(wrap(env, LENGTH))
    state = batch.reset(keys())
    caught = state.pipeline_state.qpos.at[:, :3].set(state.pipeline_state.qpos[:, 7:10])
    after = batch.step(
        replace(state, pipeline_state=state.pipeline_state.replace(qpos=caught)), ACTION
    )
    assert not np.any(after.done)
    np.testing.assert_array_equal(after.pipeline_state.qpos[:, :3], caught[:, :3])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: make(role=2), "role 2: there are 0"),
        (lambda: make(opponent=None), "duel needs an opponent"),
        (lambda: make(scenario="solo"), "takes no opponent"),
        (lambda: make(DEFENDER, None, scenario="solo"), "defender is absent"),
        (lambda: wrap(AutoResetWrapper(make()), 5, action_repeat=2), "sim.substeps"),
        (lambda: wrap(make(), 5, randomization_fn=lambda sys: sys), "share one model"),  # pyright: ignore
        (lambda: wrap(SimpleNamespace(unwrapped=3), 5), "not for int"),  # pyright: ignore
    ],
)
def test_what_cannot_be_is_one_line(wrong, words: str):
    with pytest.raises(UserError, match=words) as caught:
        wrong()
    assert "\n" not in caught.value.message
