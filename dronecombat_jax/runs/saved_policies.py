"""The policies in a checkpoint, as they are flown: for evaluations, replays, exports, tournaments.

What does not live here: reading the checkpoint (`files.checkpoint`), a policy's own file
(`policies`).
"""

from functools import lru_cache
from pathlib import Path
from typing import Any

import jax

from dronecombat_jax.config.fields import Config
from dronecombat_jax.files.arrays import Arrays, nonfinite, paths, unflatten
from dronecombat_jax.files.manifest import CheckpointError
from dronecombat_jax.learn.algorithms import algorithm_of, new_learner
from dronecombat_jax.learn.mates import Both, by_side
from dronecombat_jax.policies.file import as_flown, tensors_of
from dronecombat_jax.types import Policy


def policies_in(arrays: Arrays, config: Config, path: Path) -> Both:
    """Both sides' policies of the checkpoint at `path` from its `arrays`; leaves [S, ...].

    Raises CheckpointError where there are none that can fly.
    """
    template = _learner(config)
    try:
        leaves = [arrays[name] for name, _ in paths({"learners": template})]
    except KeyError as error:
        raise CheckpointError(f"{path}: it holds no {error.args[0]}") from None
    policies = as_flown(_live(unflatten(template, leaves), config), config.learn)
    if wrong := nonfinite(tensors_of(policies)):
        raise CheckpointError(f"{path} refused: NaN or infinity in {wrong}")
    return _of_sides(policies, config)


def policies_of(learners: Any, config: Config) -> Both:
    """Both sides' policies of `learners`, leaves [S, L, ...], as they are flown; NumPy leaves
    [S, ...].
    """
    return _of_sides(as_flown(_live(learners, config), config.learn), config)


def parameters_of(learners: Any, config: Config) -> Both:
    """The same as they learn: a log-std may be out of its bounds."""
    return _of_sides(_live(learners, config), config)


def _live(learners: Any, config: Config) -> Policy:
    """The policies of all who learn, with the leading axes of `learners`."""
    return algorithm_of(config.learn).policy(learners)


def _of_sides(policies: Policy, config: Config) -> Both:
    of_pupil = lambda index: jax.tree.map(lambda leaf: leaf[:, index], policies)
    return by_side(config.pupils, of_pupil)


@lru_cache(maxsize=32)
def _learner(config: Config) -> Any:
    """The shapes of one learner."""
    return jax.eval_shape(lambda: new_learner(jax.random.key(0), config))
