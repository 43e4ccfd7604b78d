"""What saving costs: a checkpoint with a pool of past players, saved, proven and loaded.

    python benchmarks/checkpoints.py [--slots 100] [--envs 1000] [--repeats 5]

The state is that of a real run at the paper's network sizes, filled with random numbers, which do
not compress. Saving includes fsync, reading back and both digests; loading verifies every byte.
Prints the median of each and the size.
"""

import argparse
import statistics
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from dronecombat_jax.machine import backend


def main() -> None:
    """Read the flags, measure, print."""
    parser = argparse.ArgumentParser(description="Time saving and loading a checkpoint.")
    parser.add_argument(
        "--slots", type=int, default=100, help="past players in the pool (default %(default)s)"
    )
    parser.add_argument("--envs", type=int, default=1000, help="environments (default %(default)s)")
    parser.add_argument("--repeats", type=int, default=5, help="default %(default)s")
    flags = parser.parse_args()
    backend.prepare("cpu")
    measure(flags.slots, flags.envs, flags.repeats)


def measure(slots: int, envs: int, repeats: int) -> None:
    """Save and load `repeats` times."""
    import jax
    import numpy as np

    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.config import settings
    from dronecombat_jax.files import checkpoint
    from dronecombat_jax.selfplay.chunk import init_state

    config = settings.load("duel", {"selfplay.probability": 0.2, "train.num_envs": envs})
    config = replace(
        config, train=replace(config.train, total_steps=slots * config.steps_per_chunk)
    )
    template = jax.eval_shape(lambda: init_state(Combat(config)))
    random = np.random.default_rng(0)
    state = jax.tree.map(lambda leaf: random.random(leaf.shape).astype(leaf.dtype), template)
    saving, loading = [], []
    with tempfile.TemporaryDirectory() as folder:
        for step in range(repeats):
            start = time.perf_counter()
            checkpoint.save(Path(folder) / "checkpoints", step, state, {})
            saving.append(time.perf_counter() - start)
            start = time.perf_counter()
            checkpoint.restore(Path(folder) / "checkpoints", step, template)
            loading.append(time.perf_counter() - start)
        stored = sum(
            file.stat().st_size
            for file in (Path(folder) / "checkpoints" / "0").rglob("*")
            if file.is_file()
        )
    megabytes = sum(leaf.nbytes for leaf in jax.tree.leaves(state)) / 1e6
    print(
        f"{slots} past players, {megabytes:.1f} MB of arrays, {stored / 1e6:.1f} MB on disk, median of {repeats}:"
    )
    print(
        f"  save {statistics.median(saving):.2f} s (slowest {max(saving):.2f}), load {statistics.median(loading):.2f} s"
    )


if __name__ == "__main__":
    main()
