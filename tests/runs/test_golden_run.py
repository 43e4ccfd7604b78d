"""Checkpoints of earlier formats stay readable (`golden/make_run_golden.py` made them), whatever
else changes.
"""

import json
import shutil
from pathlib import Path

import jax
import numpy as np
import pytest

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.files.manifest import SCHEMA
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.learn.rollout import policy_mean
from dronecombat_jax.runs.evaluation import load_run, policies
from dronecombat_jax.runs.resume import find_start, restored_state

GOLDEN = Path(__file__).parents[1] / "golden"


def test_every_format_has_its_golden_file():
    assert {path.name for path in GOLDEN.glob("run_v*")} == {
        f"run_v{schema}" for schema in range(1, SCHEMA + 1)
    }


@pytest.mark.parametrize("path", sorted(GOLDEN.glob("run_v*")), ids=lambda path: path.name)
def test_an_older_runs_policies_act_as_they_did(path: Path):
    expected = json.loads((path / "expected.json").read_text())
    run = load_run(path)
    assert (run.iteration, run.config.train.seed, run.config.learn.discount) == (4, 11, 0.98)
    observation = np.array(expected["observation"], np.float32)
    for policy, actions in zip(policies(run, 0), expected["actions"], strict=True):
        np.testing.assert_allclose(
            policy_mean(run.config.learn, policy, observation), actions, rtol=1e-5, atol=1e-5
        )


@pytest.mark.parametrize("path", sorted(GOLDEN.glob("run_v*")), ids=lambda path: path.name)
def test_an_older_run_can_be_gone_on_with(path: Path, tmp_path: Path):
    shutil.copytree(path / "checkpoints", tmp_path / "checkpoints")
    config = load_run(path).config
    start = find_start(RunDirectory(tmp_path), config)
    assert start is not None
    state = restored_state(start, config, Combat(config))
    assert state.iteration.tolist() == [4] and state.selfplay is not None
    # a slot for each chunk
    assert {leaf.shape[:2] for leaf in jax.tree.leaves(state.selfplay.pools)} == {(1, 3)}
