"""The record of a chunk against counts made by hand: all its fights, who was met, what was learnt."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from dronecombat_jax.config.fields import Config, SelfPlayConfig, TrainConfig
from dronecombat_jax.files.metrics import MetricsWriter, read
from dronecombat_jax.runs.chunks import ChunkLog, met, summary
from dronecombat_jax.types import Cause

CONFIG = Config(
    selfplay=SelfPlayConfig(probability=0.5),
    train=TrainConfig(num_envs=4, chunk_iterations=3, total_steps=3 * 96 * 4),
)


def record(iteration: int, episodes: int, reached: int, rate: float | None, seed: int = 0) -> dict:
    shares = dict.fromkeys(
        (f"outcome/{cause.name.lower()}" for cause in Cause if cause != Cause.NONE), 0.0
    )
    shares |= {
        "win/defender": 0.0,
        "win/draw": 0.0,
        "win/attacker": 0.0,
        "crash/defender": 0.0,
        "crash/attacker": 0.0,
    }
    row = {key: share if episodes else float("nan") for key, share in shares.items()}
    if episodes:
        row["outcome/reached"] = row["win/attacker"] = reached / episodes
    row |= {
        "iteration": iteration,
        "steps": 96 * iteration,
        "seed": seed,
        "chunk": -(-iteration // 3),
    }
    row |= {
        "episodes": episodes,
        "episode_steps": 10.0 * iteration if episodes else float("nan"),
        "diverged": iteration,
    }
    for role in ("defender", "attacker"):
        row |= {
            f"{name}/{role}": rate
            for name in ("learning_rate", "kl", "entropy", "explained_variance")
        }
    return row


def test_a_chunk_is_the_sum_of_its_fights_and_the_mean_of_what_was_learnt():
    """7 fights of 10 steps, none, 3 of 30: (70 + 90) / 10 steps; 1 + 2 of them reached the target."""
    chunk = summary([record(1, 7, 1, 0.5), record(2, 0, 0, None), record(3, 3, 2, float("nan"))])
    assert {key: chunk[key] for key in ("chunk", "iteration", "steps", "seed", "iterations", "episodes")} == {
        "chunk": 1, "iteration": 3, "steps": 288, "seed": 0, "iterations": 3, "episodes": 10,
    }  # fmt: skip
    assert (
        chunk["episode_steps"] == 16.0 and chunk["outcome/reached"] == chunk["win/attacker"] == 0.3
    )
    assert chunk["outcome/timeout"] == 0.0 and chunk["diverged"] == 6
    assert chunk["kl/defender"] == chunk["learning_rate/attacker"] == 0.5


def test_a_chunk_without_fights_or_learning_says_nothing_of_them():
    chunk = summary([record(1, 0, 0, None), record(2, 0, 0, None)])
    unknown = [key for key, value in chunk.items() if value is None]
    assert chunk["episodes"] == 0 and len(unknown) == 1 + 10 + 3 + 2 + 2 * 4
    assert summary([record(1, 1, 1, 1e-3), record(2, 1, 1, None), record(3, 1, 1, 2e-3)])[
        "kl/attacker"
    ] == pytest.approx(1.5e-3)


def selfplay(frozen: int, opponent: list[int]) -> SimpleNamespace:
    """Two seeds, pools of three slots of past attackers; seed 0 is live."""
    games = np.array([[4.0, 0.0, 0.0], [8.0, 2.0, 0.0]], np.float32)
    wins = np.array([[3.0, 0.0, 0.0], [0.0, 2.0, 0.0]], np.float32)
    return SimpleNamespace(
        frozen=np.array([-1, frozen]),
        opponent=np.array([[-1] * 4, opponent]),
        pools=(None, SimpleNamespace(wins=wins, games=games)),
    )


def test_who_was_met_and_how_the_live_player_fares():
    """(wins + 1) / (games + 2) of the slots filled so far: chunk 2 has two."""
    state = selfplay(1, [1, 1, 1, 1])
    live = met(CONFIG, state, 0, chunk=2)
    assert (live["frozen"], live["opponent"], live["opponents"]) == (None, None, 0)
    assert live["members/attacker"] == [0] and live["win_rate/attacker"] == [0.6667]
    assert "win_rate/defender" not in live
    past = met(CONFIG, state, 1, chunk=2)
    assert (past["frozen"], past["opponent"], past["opponents"]) == ("attacker", 1, 1)
    assert past["members/attacker"] == [0, 1]
    assert past["win_rate/attacker"] == [0.1, 0.75] and past["games/attacker"] == [8.0, 2.0]
    everywhere = replace(CONFIG, selfplay=replace(CONFIG.selfplay, scope="environment"))
    mixed = met(everywhere, selfplay(1, [0, 2, 2, 1]), 1, chunk=3)
    assert (mixed["opponent"], mixed["opponents"], len(mixed["win_rate/attacker"])) == (1.25, 3, 2)
    assert met(CONFIG, None, 0, chunk=1) == {"frozen": None, "opponent": None, "opponents": 0}


def test_the_record_of_a_large_pool_stays_small():
    """Of 1000 members the 64 with the most games: slots 900 to 963 of these."""
    games = np.ones((1, 1000), np.float32)
    games[0, 900:964] = 5.0
    pool = SimpleNamespace(wins=games * 0.5, games=games)
    state = SimpleNamespace(frozen=np.array([-1]), opponent=np.full((1, 4), -1), pools=(None, pool))
    assert met(CONFIG, state, 0, chunk=1000)["members/attacker"] == list(range(900, 964))


def test_chunks_are_written_at_their_ends_and_begin_anew(tmp_path: Path):
    with ChunkLog(CONFIG, tmp_path / "chunks.jsonl", tmp_path / "metrics.jsonl", 0) as chunks:
        with chunks.timed("compile"):
            pass
        for iteration in range(1, 7):
            chunks.add(record(iteration, 2, 1, 0.5))
            if iteration % 3 == 0:
                chunks.write(None)
    rows = read(tmp_path / "chunks.jsonl")
    assert [(row["chunk"], row["iterations"], row["episodes"]) for row in rows] == [
        (1, 3, 6),
        (2, 3, 6),
    ]
    assert [row["seconds/compile"] for row in rows][1] == 0.0


def test_inside_a_chunk_its_records_are_read_back_and_no_others(tmp_path: Path):
    rows = [record(iteration, iteration, 1, 0.1 * iteration) for iteration in range(1, 7)]
    with MetricsWriter(tmp_path / "metrics.jsonl") as log:
        for row in rows[:5]:
            log.write(row)
    with ChunkLog(CONFIG, tmp_path / "chunks.jsonl", tmp_path / "metrics.jsonl", 5) as chunks:
        chunks.add(rows[5])
        chunks.write(None)
    (row,) = read(tmp_path / "chunks.jsonl")
    expected = summary(rows[3:])
    assert {key: row[key] for key in expected} == expected and row["episodes"] == 15
