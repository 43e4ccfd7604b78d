"""From a program call's metrics to flat records and one progress line, against counts made by hand."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from dronecombat_jax.config.fields import Config, GameConfig, LearnConfig, TrainConfig
from dronecombat_jax.files.metrics import MetricsWriter, read
from dronecombat_jax.runs.records import progress_update, records
from dronecombat_jax.types import SIDES, Cause, IterationMetrics, RewardTerms, UpdateMetrics

CONFIG = Config(
    learn=LearnConfig(rollout_steps=10),
    train=TrainConfig(num_envs=4, chunk_iterations=2, num_seeds=2, seed=7, total_steps=240),
)
SEEDS, ITERATIONS = 2, 3


def make_report(**counts: int) -> IterationMetrics:
    """A report [2 seeds, 3 iterations]; seed 8 has the given endings in its last iteration, all
    else has none.
    """
    causes = np.zeros((SEEDS, ITERATIONS, len(Cause)), np.int32)
    for name, count in counts.items():
        causes[1, 2, Cause[name.upper()]] = count
    crashes = np.zeros((SEEDS, ITERATIONS, 2), np.int32)
    crashes[1, 2] = 4, 3
    steps = np.zeros((SEEDS, ITERATIONS), np.int32)
    steps[1, 2] = 600
    terms = {
        name: np.full((SEEDS, ITERATIONS, 2), [0.5 * i, -1.0 * i], np.float32)
        for i, name in enumerate(RewardTerms._fields)
    }
    learners = {
        name: np.full((SEEDS, ITERATIONS, 2), [i, i + 0.5], np.float32)
        for i, name in enumerate(UpdateMetrics._fields)
    }
    frozen, opponent = (
        np.full((SEEDS, ITERATIONS), -1),
        np.full((SEEDS, ITERATIONS), -1.0, np.float32),
    )
    returns = np.zeros((SEEDS, ITERATIONS, 2), np.float32)
    returns[1, 2] = 500.0, -250.0
    return IterationMetrics(  # pyright: ignore
        causes=causes,
        crashes=crashes,
        episode_steps=steps,
        returns=returns,
        diverged=causes[..., Cause.DIVERGED],
        reward_terms=RewardTerms(**terms),
        learners=UpdateMetrics(**learners),
        frozen=frozen,
        opponent=opponent,
    )


REPORT = make_report(
    intercept=6, reached=4, defender_crash=3, attacker_crash=2, both_crash=1, timeout=3, diverged=1
)


def test_one_record_for_each_iteration_and_seed_rising():
    rows = records(CONFIG, REPORT, first_iteration=3)
    assert [(row["iteration"], row["seed"]) for row in rows] == [
        (4, 7),
        (4, 8),
        (5, 7),
        (5, 8),
        (6, 7),
        (6, 8),
    ]
    # 40 environment steps each
    assert [row["steps"] for row in rows] == [160, 160, 200, 200, 240, 240]
    # iterations 3 and 4 are chunk 2, 5 and 6 chunk 3
    assert [row["chunk"] for row in rows] == [2, 2, 3, 3, 3, 3]


def test_shares_of_the_fights_that_ended():
    row = records(CONFIG, REPORT, 3)[-1]
    assert row["episodes"] == 20 and row["episode_steps"] == 30.0
    shares = {key: value for key, value in row.items() if key.startswith("outcome/")}
    assert shares == {
        "outcome/intercept": 0.3,
        "outcome/reached": 0.2,
        "outcome/defender_crash": 0.15,
        "outcome/attacker_crash": 0.1,
        "outcome/both_crash": 0.05,
        "outcome/timeout": 0.15,
        "outcome/diverged": 0.05,
        "outcome/defender_invalid": 0.0,
        "outcome/attacker_invalid": 0.0,
        "outcome/both_invalid": 0.0,
    }
    assert row["diverged"] == 1 and row["diverged_environments"] == 0.25  # of 4
    # defender: interceptions and attacker's crashes; attacker: targets and defender's crashes;
    # a tie: the rest
    assert (row["win/defender"], row["win/attacker"], row["win/draw"]) == pytest.approx(
        (0.4, 0.35, 0.25)
    )
    assert sum(shares.values()) == pytest.approx(1.0)
    assert (row["crash/defender"], row["crash/attacker"]) == (0.2, 0.15)


def test_a_time_out_can_count_for_the_defender():
    config = replace(CONFIG, game=GameConfig(timeout_rule="defender"))
    row = records(config, REPORT, 3)[-1]
    assert (row["win/defender"], row["win/attacker"], row["win/draw"]) == pytest.approx(
        (0.55, 0.35, 0.1)
    )


def test_rewards_returns_and_learners_by_role():
    row = records(CONFIG, REPORT, 3)[-1]
    assert [row[f"reward/attacker/{name}"] for name in RewardTerms._fields] == [
        -1.0 * i for i in range(7)
    ]
    assert (row["return/defender"], row["return/attacker"]) == (500.0 / 20, -250.0 / 20)
    for i, name in enumerate(UpdateMetrics._fields):
        assert (row[f"{name}/defender"], row[f"{name}/attacker"]) == (i, i + 0.5)


def test_no_fight_ended_is_nan_here_and_null_in_the_file(tmp_path):
    rows = records(CONFIG, REPORT, 3)
    empty = rows[0]
    assert empty["episodes"] == 0
    unknown = [
        key
        for key in empty
        if key.split("/")[0] in ("outcome", "win", "crash", "return", "episode_steps")
    ]
    assert len(unknown) == 10 + 3 + 2 + 2 + 1 and all(math.isnan(empty[key]) for key in unknown)
    with MetricsWriter(tmp_path / "metrics.jsonl") as writer:
        for row in rows:
            writer.write(row)
    stored = read(tmp_path / "metrics.jsonl")
    assert [set(row) for row in stored] == [set(rows[0])] * 6
    assert all(stored[0][key] is None for key in unknown) and stored[-1]["outcome/intercept"] == 0.3
    assert json.loads((tmp_path / "metrics.jsonl").read_text().splitlines()[0])["seed"] == 7


def learnt(row: dict) -> dict[str, bool]:
    """Of each role, whether it reports numbers of its learning, which are then all there."""
    numbers = {
        role: [row[f"{name}/{role}"] is not None for name in UpdateMetrics._fields]
        for role in SIDES
    }
    assert all(len(set(known)) == 1 for known in numbers.values())
    return {role: known[0] for role, known in numbers.items()}


def test_an_agent_that_does_not_learn_reports_nothing_of_it():
    both, attacker = {"defender": True, "attacker": True}, {"defender": False, "attacker": True}
    assert all(learnt(row) == both for row in records(CONFIG, REPORT, 0))
    solo = replace(CONFIG, game=GameConfig(scenario="solo"))
    assert all(learnt(row) == attacker for row in records(solo, REPORT, 0))
    # 80 steps are one chunk of two iterations; the report's three iterations are the second to the
    # fourth.
    ahead = replace(CONFIG, train=replace(CONFIG.train, head_start_steps=80))
    assert [learnt(row) for row in records(ahead, REPORT, 1)] == [attacker] * 2 + [both] * 4


def test_a_role_that_is_played_by_its_past_reports_nothing_of_its_learning(tmp_path):
    frozen = np.array([[-1, 1, 0], [-1, -1, 1]])
    report = REPORT._replace(frozen=frozen, opponent=np.where(frozen < 0, -1.0, 2.5))
    rows = records(CONFIG, report, 0)
    assert [row["frozen"] for row in rows] == [None, None, 1, None, 0, 1]
    assert [row["opponent"] for row in rows] == [None, None, 2.5, None, 2.5, 2.5]
    assert [learnt(row)["attacker"] for row in rows] == [True, True, False, True, True, False]
    assert [learnt(row)["defender"] for row in rows] == [True, True, True, True, False, True]
    with MetricsWriter(tmp_path / "metrics.jsonl", tmp_path / "tensorboard") as writer:
        for row in rows:
            writer.write(row)
    assert read(tmp_path / "metrics.jsonl")[2]["learning_rate/attacker"] is None


def test_steps_are_counted_far_beyond_32_bits():
    row = records(CONFIG, REPORT, first_iteration=2**31 - 5)[-1]
    assert row["iteration"] == 2**31 - 2 and row["steps"] == 40 * (2**31 - 2)
    assert progress_update(CONFIG, REPORT, 2**31 - 2).steps == 80 * (2**31 - 2)


def test_progress_shows_all_seeds_and_iterations_of_a_call():
    update = progress_update(CONFIG, REPORT, iterations_done=6)
    assert update.steps == 480 and update.note == "chunk 3/3"
    assert (update.defender_wins, update.attacker_wins, update.ties) == pytest.approx(
        (0.4, 0.35, 0.25)
    )
    assert (update.defender_crashes, update.attacker_crashes) == (0.2, 0.15)
    nothing = progress_update(CONFIG, make_report(), iterations_done=5)
    assert (
        math.isnan(nothing.defender_wins)
        and math.isnan(nothing.ties)
        and nothing.note == "chunk 3/3"
    )
