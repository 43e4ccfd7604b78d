"""Past players on the disk: each stored once, proven as a whole, made again from its checkpoint
where it is damaged.
"""

import shutil
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest
from saved_runs import _random
from toy import CONFIG, Coasting, assert_same_bits

from dronecombat_jax.config.fields import Config, SelfPlayConfig
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.files import checkpoint
from dronecombat_jax.files.manifest import CheckpointError
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.learn.rollout import policy_of
from dronecombat_jax.runs.past_players import Players, emptied, filled_slots
from dronecombat_jax.runs.provenance import describe
from dronecombat_jax.runs.resume import find_start, load_state
from dronecombat_jax.selfplay.chunk import init_state
from dronecombat_jax.types import TrainState

CHUNKS = 5
SELFPLAY = replace(
    CONFIG,
    selfplay=SelfPlayConfig(probability=0.5, roles="both"),
    train=replace(CONFIG.train, total_steps=CHUNKS * CONFIG.steps_per_chunk, num_seeds=2),
)


def states(config: Config, chunks: int) -> list[TrainState]:
    """A made-up state at each chunk's end whose pools hold the earlier states' live policies, as in
    a real run.
    """
    shapes = jax.eval_shape(lambda: init_state(Coasting(config)))
    made = []
    for chunk in range(chunks + 1):
        rng = np.random.default_rng(chunk)
        state = jax.tree.map(lambda leaf, rng=rng: _random(rng, leaf), shapes)
        iteration = np.full(config.train.num_seeds, chunk * config.train.chunk_iterations, np.int32)
        pools = []
        for role, pool in enumerate(state.selfplay.pools):
            policies = jax.tree.map(np.zeros_like, pool.policies)
            for slot, earlier in enumerate(made):
                live = jax.tree.map(
                    lambda leaf, role=role: leaf[:, role], policy_of(earlier.learners)
                )
                jax.tree.map(
                    lambda whole, one, slot=slot: whole.__setitem__((slice(None), slot), one),
                    policies,
                    live,
                )
            pools.append(pool.replace(policies=policies))
        made.append(
            state.replace(iteration=iteration, selfplay=state.selfplay.replace(pools=tuple(pools)))
        )
    return made


@pytest.fixture(scope="module")
def saved(tmp_path_factory) -> tuple[Path, list[TrainState]]:
    """A run of five chunks."""
    home, made = tmp_path_factory.mktemp("run"), states(SELFPLAY, CHUNKS)
    (home / "checkpoints").mkdir()
    players = Players(home / "checkpoints")
    for state in made:
        save(home, state, players)
    return home, made


def save(home: Path, state: TrainState, players: Players) -> None:
    iteration = int(state.iteration[0])
    apart, roster = players.store(state, filled_slots(iteration, SELFPLAY.train.chunk_iterations))
    checkpoint.save(
        home / "checkpoints", iteration, apart, describe(SELFPLAY, iteration), players=roster
    )


@pytest.fixture
def copied(saved, tmp_path: Path) -> Path:
    shutil.copytree(saved[0] / "checkpoints", tmp_path / "checkpoints")
    return tmp_path


def loaded(home: Path) -> TrainState:
    start = find_start(RunDirectory(home), SELFPLAY)
    assert start is not None
    return load_state(start, Coasting(SELFPLAY))


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def test_what_was_saved_comes_back_and_no_checkpoint_holds_a_pool(saved):
    home, made = saved
    assert_same_bits(loaded(home), made[-1])
    assert sorted(path.name for path in (home / "checkpoints/players").iterdir()) == [
        f"{slot}.safetensors" for slot in range(CHUNKS)
    ]
    manifest = checkpoint.verify(home / "checkpoints", CHUNKS * SELFPLAY.train.chunk_iterations)
    shapes = {leaf.shape[1] for leaf in manifest.leaves if "/policies/" in leaf.path}
    assert shapes == {0} and manifest.players is not None and manifest.players.slots == CHUNKS


def test_inside_a_chunk_its_own_start_is_in_the_pool():
    assert [filled_slots(iteration, 10) for iteration in (0, 1, 9, 10, 11, 20)] == [
        0,
        1,
        1,
        1,
        2,
        2,
    ]


def test_a_pool_that_a_killed_process_left_is_used_and_another_is_replaced(saved, copied):
    _, made = saved
    for slot in (3, 4):
        shutil.copy(
            copied / "checkpoints/players/2.safetensors",
            copied / f"checkpoints/players/{slot}.safetensors",
        )
    before = (copied / "checkpoints/players/1.safetensors").stat().st_mtime_ns
    save(copied, made[-1], Players(copied / "checkpoints"))
    assert_same_bits(loaded(copied), made[-1])
    assert (copied / "checkpoints/players/1.safetensors").stat().st_mtime_ns == before


@pytest.mark.parametrize(
    "fault", [flip, Path.unlink, lambda path: path.write_bytes(b"")], ids=["flip", "gone", "empty"]
)
def test_a_damaged_player_is_made_again_from_its_own_checkpoint(saved, copied, fault, caplog):
    fault(copied / "checkpoints/players/2.safetensors")
    assert_same_bits(loaded(copied), saved[1][-1])
    assert (
        f"past player 2 made again from checkpoint {2 * SELFPLAY.train.chunk_iterations}"
        in caplog.text
    )
    caplog.clear()
    assert_same_bits(loaded(copied), saved[1][-1])
    assert caplog.text == ""


def test_a_player_that_cannot_be_made_again_costs_the_checkpoints_that_need_it(
    saved, copied, caplog
):
    flip(copied / "checkpoints/players/2.safetensors")
    shutil.rmtree(copied / f"checkpoints/{2 * SELFPLAY.train.chunk_iterations}")
    state = loaded(copied)
    assert_same_bits(state, saved[1][1])  # chunk 2's is gone, and later ones need player 2
    assert "checkpoint 10 skipped" in caplog.text and "2.safetensors" in caplog.text
    assert (copied / "checkpoints/10").is_dir()  # it is sound itself, and stays where it is


def test_another_runs_players_are_refused(saved, copied):
    home, made = saved
    shifted = made[-1].replace(selfplay=jax.tree.map(lambda leaf: leaf + 1, made[-1].selfplay))
    Players(copied / "checkpoints").store(shifted, CHUNKS)  # sound files of somebody else
    with pytest.raises(
        CheckpointError, match="not the past players that the checkpoint was saved with"
    ):
        roster = checkpoint.verify(home / "checkpoints", 10).players
        assert roster is not None
        Players(copied / "checkpoints").read(roster)


def test_a_disk_that_refuses_a_player_is_one_line(saved, tmp_path):
    (tmp_path / "checkpoints").mkdir()
    (tmp_path / "checkpoints/players").write_text("a file in its place")
    with pytest.raises(UserError, match=r"cannot write .*players") as caught:
        Players(tmp_path / "checkpoints").store(saved[1][-1], CHUNKS)
    assert caught.value.exit_code == 73 and "\n" not in caught.value.message


def test_emptied_pools_keep_their_records(saved):
    selfplay = saved[1][-1].selfplay
    assert selfplay is not None
    small = emptied(selfplay)
    for pool, whole in zip(small.pools, selfplay.pools, strict=True):
        assert pool is not None and whole is not None
        assert_same_bits((pool.wins, pool.games), (whole.wins, whole.games))
        assert all(leaf.size == 0 for leaf in jax.tree.leaves(pool.policies))


def test_a_reader_of_policies_needs_no_past_player(saved, copied):
    shutil.rmtree(copied / "checkpoints/players")
    start = find_start(RunDirectory(saved[0]), SELFPLAY)
    assert start is not None
    state = load_state(
        start._replace(checkpoints=copied / "checkpoints", members=None),
        Coasting(SELFPLAY),
        pools=False,
    )
    assert_same_bits(state.learners, saved[1][-1].learners)
    with pytest.raises(UserError) as caught:
        load_state(
            start._replace(checkpoints=copied / "checkpoints", members=None), Coasting(SELFPLAY)
        )
    assert caught.value.exit_code == EXIT_DATA
