"""Going on from a real checkpoint: the same bits, or one line that says why not.

The programs are the toy's; what a user's process does is in `test_training` and `test_kills`.
"""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import jax
import numpy as np
import pytest
from toy import CHUNK, CONFIG, assert_same_bits, build

from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config, SelfPlayConfig
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA, UserError
from dronecombat_jax.files import checkpoint
from dronecombat_jax.files.arrays import flatten, match_template
from dronecombat_jax.files.manifest import CheckpointError, state_digest
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.runs.evaluation import load_run
from dronecombat_jax.runs.past_players import Players, emptied, filled_slots
from dronecombat_jax.runs.provenance import describe
from dronecombat_jax.runs.resume import find_start, read_start, restored_state
from dronecombat_jax.selfplay.chunk import init_state
from dronecombat_jax.types import TrainState

HALF, WHOLE = 3 * CHUNK, 6 * CHUNK  # iterations
INSIDE = HALF + 1  # of a chunk: who is met in it is then part of the state
CHUNKS_OF_SIX = replace(CONFIG.train, head_start_steps=0, total_steps=6 * CONFIG.steps_per_chunk)
METHODS = {
    "ippo": replace(CONFIG, train=CHUNKS_OF_SIX),
    "sippo": replace(
        CONFIG, train=CHUNKS_OF_SIX, selfplay=SelfPlayConfig(probability=1.0, roles="both")
    ),
    "mappo": replace(
        CONFIG,
        train=CHUNKS_OF_SIX,
        learn=replace(CONFIG.learn, critic="central"),
        selfplay=SelfPlayConfig(probability=0.5),
    ),
    "teams": replace(
        CONFIG,
        train=CHUNKS_OF_SIX,
        game=replace(CONFIG.game, defenders=2),
        selfplay=SelfPlayConfig(probability=0.5, roles="both"),
    ),
}
METHODS["mates"] = replace(METHODS["teams"], learn=replace(CONFIG.learn, mates="own"))
METHODS["memory"] = replace(
    METHODS["teams"], learn=replace(CONFIG.learn, memory="gru", memory_size=6)
)
SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in METHODS if name != "sippo"]


@pytest.fixture(scope="module", params=["sippo", *SLOW])
def run(request, tmp_path_factory) -> SimpleNamespace:
    """Six chunks straight, one iteration a call, with checkpoints on the way."""
    config = METHODS[request.param]
    program = build(config, 1)
    directory = RunDirectory(tmp_path_factory.mktemp(request.param))
    state, reports = program.start, []
    for iteration in range(WHOLE + 1):
        if iteration in (0, HALF, INSIDE):
            save(directory, config, state)
        if iteration < WHOLE:
            state, report = program.run(state)
            reports.append(digest(report))
    return SimpleNamespace(
        name=request.param,
        config=config,
        program=program,
        directory=directory,
        digest=digest(state),
        reports=reports,
        last=state,
    )


def save(directory: RunDirectory, config: Config, state: TrainState) -> None:
    iteration = int(state.iteration[0])
    directory.checkpoints.mkdir(exist_ok=True)
    filled = filled_slots(iteration, config.train.chunk_iterations)
    apart, roster = Players(directory.checkpoints).store(jax.device_get(state), filled)
    checkpoint.save(
        directory.checkpoints, iteration, apart, describe(config, iteration), players=roster
    )


def digest(state: Any) -> str:
    return state_digest(flatten(jax.device_get(state)))


def fly_on(run: SimpleNamespace, state: TrainState, reports: list[str] | None = None) -> TrainState:
    """The state at the end; digests of what was reported are appended to `reports`."""
    for _ in range(WHOLE - int(state.iteration[0])):
        state, report = run.program.run(state)
        if reports is not None:
            reports.append(digest(report))
    return state


@pytest.mark.parametrize("iteration", [0, HALF, INSIDE])
@pytest.mark.long
def test_six_chunks_straight_are_six_chunks_with_a_checkpoint_between(run, iteration):
    state = restored_state(read_start(run.directory, iteration), run.config, run.program.combat)
    assert digest(fly_on(run, state)) == run.digest


@pytest.mark.long
def test_a_run_that_lost_any_leaf_of_its_state_is_another_run(run):
    """The key test's mutation: each leaf in turn is zeros, or ones where that is what it was."""
    start = read_start(run.directory, INSIDE)
    state = restored_state(start, run.config, run.program.combat)
    leaves, structure = jax.tree.flatten(state)
    unnoticed = []
    for i, (path, leaf) in enumerate(jax.tree_util.tree_leaves_with_path(state)):
        lost = np.zeros_like(leaf) if np.any(leaf) else np.ones_like(leaf)
        reports: list[str] = []
        after = fly_on(
            run, jax.tree.unflatten(structure, [*leaves[:i], lost, *leaves[i + 1 :]]), reports
        )
        if digest(after) == run.digest and reports == run.reports[INSIDE:]:
            unnoticed.append(jax.tree_util.keystr(path))
    assert unnoticed == [] and len(leaves) > 50


@pytest.mark.long
def test_a_checkpoint_without_any_one_of_its_leaves_is_refused_by_its_name(run, tmp_path):
    arrays, manifest = checkpoint.load(run.directory.checkpoints, INSIDE)
    template = jax.eval_shape(lambda: init_state(run.program.combat))
    if manifest.players is not None:
        template = template.replace(selfplay=emptied(template.selfplay))
    for gone in manifest.leaves:
        rest = tuple(leaf for leaf in manifest.leaves if leaf != gone)
        with pytest.raises(CheckpointError, match=f"{gone.path}: expected .*, got nothing"):
            match_template(template, rest, "a checkpoint", "")
    rest = {path: array for path, array in arrays.items() if path != "env/clock"}
    checkpoint.save(
        tmp_path / "checkpoints",
        INSIDE,
        rest,
        describe(run.config, INSIDE),
        players=manifest.players,
    )
    start = read_start(RunDirectory(tmp_path), INSIDE)
    with pytest.raises(CheckpointError, match=r"env/clock: expected int32\[1,8\], got nothing"):
        restored_state(start, run.config, run.program.combat)


def longer(config: Config, chunks: int) -> Config:
    return replace(config, train=replace(config.train, total_steps=chunks * config.steps_per_chunk))


@pytest.mark.long
def test_a_run_made_longer_is_the_run_that_was_always_that_long(run, tmp_path):
    """Pools have a slot for every chunk: the shorter run's are restored as they were and then grow."""
    short = RunDirectory(tmp_path)
    config = longer(run.config, 3)
    # without pools the programs are the same
    program = run.program if run.name == "ippo" else build(config, 1)
    state = program.start
    for _ in range(HALF):
        state, _ = program.run(state)
    save(short, config, state)
    # as left by a process that was killed before it saved
    short.config.write_text(settings.to_toml(run.config))
    start = find_start(short, run.config)
    assert start is not None and start.config == config
    state = restored_state(start, run.config, run.program.combat)
    assert digest(fly_on(run, state)) == run.digest
    assert load_run(short.path).config == config  # the checkpoint's own


def test_a_run_made_shorter_drops_slots_that_are_empty(run):
    start = read_start(run.directory, HALF)
    state = restored_state(start, longer(run.config, 4), run.program.combat)
    if state.selfplay is not None:
        assert all(leaf.shape[1] == 4 for leaf in jax.tree.leaves(state.selfplay.pools))
    assert_same_bits(state.learners, restored_state(start, run.config, run.program.combat).learners)


def test_a_reader_needs_nothing_but_the_checkpoint(run):
    """No config.toml was ever written here."""
    newest = load_run(run.directory.path)
    assert newest.config == run.config and newest.iteration == INSIDE
    assert load_run(run.directory.path, chunk=3).iteration == HALF
    assert_same_bits(
        load_run(run.directory.path, chunk=0).state.learners, run.program.start.learners
    )
    with pytest.raises(UserError, match="no checkpoint 8") as caught:
        load_run(run.directory.path, chunk=4)
    assert caught.value.exit_code == EXIT_DATA


EDITS = {
    "train.seed": 5,
    "train.num_envs": 4,
    "learn.hidden_sizes": (8, 4),
    "learn.learning_rate": 1e-4,
    "game.episode_steps": 30,
    "selfplay.probability": 0.1,
    "train.total_steps": 4000,
    "run.name": "another",
    "run.figures": False,
    "sim.mjcf": "/moved/drone.xml",  # what it says is compared, not where it lies
}


@pytest.mark.parametrize("key", EDITS)
def test_what_may_change_of_a_run_and_what_needs_a_fork(tmp_path, key):
    directory = RunDirectory(tmp_path)
    checkpoint.save(directory.checkpoints, 4, {"a": np.ones(2)}, describe(CONFIG, 4))
    section, name = key.split(".")
    config = replace(CONFIG, **{section: replace(getattr(CONFIG, section), **{name: EDITS[key]})})
    if key.startswith(("run.", "train.total_steps", "sim.mjcf")):
        start = find_start(directory, config)
        assert start is not None and start.iteration == 4
        return
    with pytest.raises(UserError) as caught:
        find_start(directory, config)
    assert caught.value.exit_code == EXIT_CONFIG and f"{key} was " in caught.value.message
    assert "--fork NEW_NAME" in caught.value.message


# What a checkpoint says about itself
