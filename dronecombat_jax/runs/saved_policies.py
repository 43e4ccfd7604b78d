"""The policies in a checkpoint, as they are flown: for evaluations, replays, exports, tournaments.

What does not live here: reading the checkpoint (`files.checkpoint`), a policy's own file
(`policies`).
"""

from functools import lru_cache
from pathlib import Path
from typing import Any

import jax

from dronecombat_jax.config.fields import Config, LearnConfig
from dronecombat_jax.files.arrays import Arrays, nonfinite, paths, unflatten
from dronecombat_jax.files.manifest import CheckpointError
from dronecombat_jax.learn.algorithms import algorithm_of, new_learner
from dronecombat_jax.policies.file import as_flown, tensors_of
from dronecombat_jax.types import Policy


def policies_in(arrays: Arrays, config: Config, path: Path) -> Policy:
    """All policies of the checkpoint at `path` from its `arrays`; leaves [S, A, ...].

    Raises CheckpointError where there are none that can fly.
    """
    template = _learner(config)
    try:
        leaves = [arrays[name] for name, _ in paths({"learners": template})]
    except KeyError as error:
        raise CheckpointError(f"{path}: it holds no {error.args[0]}") from None
    policies = policies_of(unflatten(template, leaves), config.learn)
    if wrong := nonfinite(tensors_of(policies)):
        raise CheckpointError(f"{path} refused: NaN or infinity in {wrong}")
    return policies


def policies_of(learners: Any, learn: LearnConfig) -> Policy:
    """The policies of `learners`; NumPy leaves, with any leading axes."""
    return as_flown(algorithm_of(learn).policy(learners), learn)


@lru_cache(maxsize=32)
def _learner(config: Config) -> Any:
    """The shapes of one learner."""
    return jax.eval_shape(lambda: new_learner(jax.random.key(0), config))
