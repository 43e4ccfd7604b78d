"""A run begun from another one's checkpoint: what is carried over, what is new, what cannot be
changed.
"""

from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from drones import write
from toy import CHUNK, CONFIG, Coasting, assert_same_bits

from dronecombat_jax.config.fields import Config, SelfPlayConfig
from dronecombat_jax.config.schema import shown
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA, UserError
from dronecombat_jax.files import checkpoint
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.learn.rollout import policy_of
from dronecombat_jax.runs import fork
from dronecombat_jax.runs.provenance import describe
from dronecombat_jax.runs.resume import Start
from dronecombat_jax.selfplay.chunk import init_state
from dronecombat_jax.types import TrainState

SIPPO = replace(CONFIG, selfplay=SelfPlayConfig(probability=0.2))


@pytest.fixture(params=[CONFIG, SIPPO], ids=["ippo", "sippo"])
def parent(request, tmp_path) -> SimpleNamespace:
    """A run after 0, 1 and 2 chunks; its numbers are drawn, and higher in each checkpoint."""
    run, rng = RunDirectory(tmp_path / "parent"), np.random.default_rng(0)
    run.path.mkdir()
    shapes = jax.eval_shape(lambda: init_state(Coasting(request.param)))
    for iteration in (0, CHUNK, 2 * CHUNK):
        state = jax.tree.map(
            lambda leaf, i=iteration: (rng.random(leaf.shape) + i).astype(leaf.dtype), shapes
        )
        state = state.replace(
            iteration=np.array([iteration], np.int32), seed=np.array([4], np.uint32)
        )
        checkpoint.save(run.checkpoints, iteration, state, describe(request.param, iteration))
    return SimpleNamespace(run=run, config=request.param, newest=state)


def change(config: Config, key: str, value: object) -> Config:
    section, name = key.split(".")
    return replace(config, **{section: replace(getattr(config, section), **{name: value})})


def forked(
    parent: SimpleNamespace, config: Config, chunk: int | None = None
) -> tuple[Start, TrainState]:
    start = fork.fork_start(parent.run, chunk, config)
    return start, fork.forked_state(start, config, Coasting(config))


def test_a_fork_without_a_change_is_a_copy_of_the_newest_or_of_a_chunk(parent):
    start, state = forked(parent, parent.config)
    assert start.iteration == 2 * CHUNK and start.changed == ("no setting",)
    assert_same_bits(state, parent.newest)
    start, state = forked(parent, parent.config, chunk=1)
    assert start.iteration == CHUNK and int(state.iteration[0]) == CHUNK


def test_another_drone_is_a_change_that_is_listed(parent, tmp_path):
    file = str(write(tmp_path))
    start, state = forked(parent, change(parent.config, "sim.mjcf", file))
    assert start.changed == (f'sim.mjcf was "", now {shown(file)}',)
    assert not np.any(state.env.qvel)  # all fights begin anew


def test_what_changes_is_listed_and_the_rest_of_the_state_is_kept(parent):
    config = change(change(parent.config, "learn.discount", 0.9), "learn.initial_log_std", -1.0)
    # these need no fork
    config = change(change(config, "train.total_steps", 4000), "run.name", "other")
    start, state = forked(parent, config)
    assert start.changed == (
        "learn.initial_log_std was 0.0, now -1.0 (this only matters at a run's start)",
        "learn.discount was 0.99, now 0.9",
    )
    assert_same_bits(
        (state.learners, state.env, state.seed),
        (parent.newest.learners, parent.newest.env, parent.newest.seed),
    )
    if state.selfplay is not None and state.selfplay.pools[1] is not None:
        assert state.selfplay.pools[1].wins.shape == (1, config.num_chunks)


def test_a_fork_may_average_its_last_policies_and_one_of_it_may_stop(parent):
    averaging = change(parent.config, "learn.average_share", 0.5)
    _, state = forked(parent, averaging)
    assert_same_bits(state.mean, policy_of(state.learners))
    assert_same_bits(state.replace(mean=None), parent.newest)
    checkpoint.save(parent.run.checkpoints, 3 * CHUNK, state, describe(averaging, 3 * CHUNK))
    assert_same_bits(forked(parent, averaging)[1], state)
    assert forked(parent, parent.config)[1].mean is None


def test_a_new_seed_and_a_new_learning_rate_are_taken_over(parent):
    _, state = forked(
        parent, change(change(parent.config, "train.seed", 7), "learn.learning_rate", 0.001)
    )
    assert state.seed.tolist() == [7] and state.seed.dtype == np.uint32
    np.testing.assert_array_equal(state.learners.learning_rate, np.full((1, 2), 0.001, np.float32))
    assert_same_bits(state.learners.parameters, parent.newest.learners.parameters)


def test_in_a_changed_environment_the_fights_begin_anew(parent):
    _, state = forked(parent, change(parent.config, "game.spawn", "uniform"))
    assert state.env.qpos.shape == parent.newest.env.qpos.shape and not np.any(state.env.qvel)
    # not the three points
    assert len(np.unique(np.asarray(state.env.qpos)[0, :, 0])) == CONFIG.train.num_envs
    assert_same_bits(state.learners, parent.newest.learners)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("sensor.latency", 2),
        ("sensor.dropout", 0.5),
        ("sim.actuation", "mixed"),
        ("defender.mass", 1.2),
    ],
)
def test_a_fork_may_give_drones_another_craft(parent, key, value):
    """Whose numbers the fights under way do not have: all begin anew."""
    _, state = forked(parent, change(parent.config, key, value))
    assert state.env.craft is not None and not np.any(state.env.qvel)
    assert_same_bits(state.learners, parent.newest.learners)


@pytest.mark.parametrize(
    ("key", "value", "tensors"),
    [
        (
            "learn.hidden_sizes",
            (8, 4),
            "parameters/policy/weights/1: expected float32[1,2,8,4], got float32[1,2,8,8]",
        ),
        ("learn.critic", "central", "weights/0: expected float32[1,2,37,8], got float32[1,2,35,8]"),
        ("game.observation", "bearing", "expected float32[1,2,23,8], got float32[1,2,35,8]"),
        ("train.num_envs", 10, "env/qpos: expected float32[1,10,14], got float32[1,8,14]"),
        ("train.num_seeds", 2, "expected float32[2,2,"),
    ],
)
def test_what_would_change_shapes_is_refused_by_tensor_and_key(parent, key, value, tensors):
    with pytest.raises(UserError) as caught:
        forked(parent, change(parent.config, key, value))
    assert caught.value.exit_code == EXIT_DATA and "\n" not in caught.value.message
    assert tensors in caught.value.message and caught.value.message.endswith(
        f"--fork cannot change {key}"
    )


def test_self_play_ends_with_a_fork_but_does_not_begin_with_one(parent):
    _, state = forked(parent, change(parent.config, "selfplay.probability", 0.0))
    assert state.selfplay is None
    wanted = change(change(parent.config, "selfplay.probability", 0.3), "selfplay.roles", "both")
    with pytest.raises(
        UserError, match=r"selfplay/.*expected .*, got nothing.*--fork cannot change selfplay\."
    ):
        forked(parent, wanted)


@pytest.mark.parametrize(
    ("key", "value"), [("learn.rollout_steps", 12), ("train.chunk_iterations", 4)]
)
def test_what_iterations_are_is_not_changed(parent, key, value):
    with pytest.raises(UserError, match=f"--fork cannot change {key} of .*parent") as caught:
        fork.fork_start(parent.run, None, change(parent.config, key, value))
    assert caught.value.exit_code == EXIT_CONFIG


def test_a_run_that_is_there_is_gone_on_with_only_if_it_is_a_fork_of_this_one(parent, tmp_path):
    start = fork.fork_start(parent.run, None, parent.config)
    here = RunDirectory(tmp_path / "child")
    with_meta = lambda meta: start._replace(manifest=start.manifest._replace(meta=meta))
    fork.check_origin(here, with_meta({"forked": fork.origin(parent.run, start)}), parent.run)
    for meta in ({}, {"forked": {"run": "another", "iteration": 4}}):
        with pytest.raises(
            UserError, match=r"is no fork of .*parent: choose another name"
        ) as caught:
            fork.check_origin(here, with_meta(meta), parent.run)
        assert caught.value.exit_code == EXIT_CONFIG
