"""Runs that were never trained: checkpoints of random players, for tests of what is made of them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
from toy import CONFIG, Coasting

from dronecombat_jax.config.fields import Config
from dronecombat_jax.files import checkpoint
from dronecombat_jax.runs.provenance import describe
from dronecombat_jax.selfplay.chunk import init_state

GAME = replace(CONFIG.game, episode_steps=30, crash_rule="out")
TOY = replace(CONFIG, game=GAME, train=replace(CONFIG.train, total_steps=10**4))


def write_run(
    path: Path,
    config: Config = TOY,
    chunks: int | range = 3,
    seed: int = 0,
    met: dict[str, Any] | None = None,
) -> Path:
    """A run at `path`: checkpoints after `chunks` chunks (0, untrained, too; or those of a range).

    `met`: the environment that they say they were trained in; None: that of `config`.
    """
    shapes = jax.eval_shape(lambda: init_state(Coasting(config)))
    path.mkdir(parents=True, exist_ok=True)
    for chunk in range(chunks + 1) if isinstance(chunks, int) else chunks:
        rng = np.random.default_rng([seed, chunk])
        state = jax.tree.map(lambda leaf, rng=rng: _random(rng, leaf), shapes)
        iteration = chunk * config.train.chunk_iterations
        checkpoint.save(path / "checkpoints", iteration, state, describe(config, iteration, met))
    return path


def newest(checkpoints: Path, **options: bool) -> int | None:
    """The step of the newest checkpoint that verifies, or None."""
    manifest = checkpoint.latest(checkpoints, **options)
    return None if manifest is None else manifest.step


def damage(path: Path, chunk: int, config: Config = TOY) -> None:
    """Flip a byte of a checkpoint's largest file."""
    folder = path / "checkpoints" / str(chunk * config.train.chunk_iterations)
    largest = max(
        (file for file in folder.rglob("*") if file.is_file()), key=lambda file: file.stat().st_size
    )
    data = bytearray(largest.read_bytes())
    data[len(data) // 2] ^= 1
    largest.write_bytes(data)


def _random(rng: np.random.Generator, leaf: jax.ShapeDtypeStruct) -> np.ndarray:
    if leaf.dtype == np.float32:
        return (
            np.abs(rng.standard_normal(leaf.shape, np.float32))
            if leaf.ndim < 4
            else rng.standard_normal(leaf.shape, np.float32)
        )
    return np.zeros(leaf.shape, leaf.dtype)
