"""Write `run_v3/`: a run's checkpoint as this version saves it, and what its policies do.
`tests/runs/test_golden_run.py` reads it.

    python tests/golden/make_run_golden.py

A golden file is made once for each format (`files.manifest.SCHEMA`) and kept: later versions must
read it.
"""

import json
from pathlib import Path

from dronecombat_jax.machine import backend

backend.prepare("cpu")

import jax  # noqa: E402 - after prepare
import numpy as np  # noqa: E402

from dronecombat_jax.combat.env import Combat  # noqa: E402
from dronecombat_jax.config.fields import Config, LearnConfig, SelfPlayConfig, TrainConfig  # noqa: E402
from dronecombat_jax.files import checkpoint  # noqa: E402
from dronecombat_jax.files.manifest import SCHEMA  # noqa: E402
from dronecombat_jax.learn.rollout import policy_mean  # noqa: E402
from dronecombat_jax.runs.evaluation import load_run, policies  # noqa: E402
from dronecombat_jax.runs.past_players import Players, filled_slots  # noqa: E402
from dronecombat_jax.runs.provenance import describe  # noqa: E402
from dronecombat_jax.selfplay.chunk import init_state  # noqa: E402

CONFIG = Config(
    learn=LearnConfig(hidden_sizes=(6, 5), rollout_steps=6, minibatches=2, discount=0.98),
    selfplay=SelfPlayConfig(probability=0.5),
    train=TrainConfig(num_envs=2, chunk_iterations=2, total_steps=72, seed=11),
)
ITERATION = 4  # two chunks of three


def main() -> None:
    home = Path(__file__).parent / f"run_v{SCHEMA}"
    home.mkdir()
    combat, rng = Combat(CONFIG), np.random.default_rng(0)
    shapes = jax.eval_shape(lambda: init_state(combat))
    state = jax.tree.map(
        lambda leaf: (rng.standard_normal(leaf.shape) ** 2).astype(leaf.dtype), shapes
    )
    state = state.replace(iteration=np.array([ITERATION], np.int32), seed=np.array([11], np.uint32))
    (home / "checkpoints").mkdir()
    filled = filled_slots(ITERATION, CONFIG.train.chunk_iterations)
    state, roster = Players(home / "checkpoints").store(state, filled)
    checkpoint.save(
        home / "checkpoints", ITERATION, state, describe(CONFIG, ITERATION), players=roster
    )
    observation = rng.standard_normal((3, 35)).astype(np.float32)
    run = load_run(home)
    actions = [
        np.asarray(policy_mean(CONFIG.learn, policy, observation)).tolist()
        for policy in policies(run, 0)
    ]
    (home / "expected.json").write_text(
        json.dumps({"observation": observation.tolist(), "actions": actions})
    )


if __name__ == "__main__":
    main()
