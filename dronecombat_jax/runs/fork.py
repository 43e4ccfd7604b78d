"""`dronecombat train --fork NEW_NAME`: another run, begun from a checkpoint of an existing one with
other settings.

The counters go on from the checkpoint, so steps, chunks and random numbers are those of a run that
has come this far. What does not live here: a run that goes on unchanged (`resume`).
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.files.arrays import flatten, leaves_of, match_template
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.runs.resume import (
    NO_CHANGE,
    Start,
    difference,
    newest_start,
    restored_state,
)

if TYPE_CHECKING:
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.types import TrainState

# Steps and chunks are counted in iterations, all of one length.
COUNTED_IN = ("learn.rollout_steps", "train.chunk_iterations")
SHAPES = (
    "learn.hidden_sizes",
    "learn.critic",
    "learn.mates",
    "learn.others",
    "learn.others_size",
    "learn.memory",
    "learn.frames",
    "learn.memory_size",
    "train.num_envs",
    "train.num_seeds",
    "selfplay.probability",
    "selfplay.roles",
    "selfplay.opponents",
    "game.observation",
    "game.nearest_k",
    "game.defenders",
    "game.attackers",
)
ONLY_AT_THE_START = ("learn.hidden_gain", "learn.policy_output_gain", "learn.initial_log_std")


def fork_start(source: RunDirectory, chunk: int | None, config: Config) -> Start:
    """The checkpoint to fork: the newest good one of `source`, or that of `chunk`.

    Raises UserError 2 where `config` changes how iterations are counted, 3 where there is no such
    checkpoint.
    """
    start = newest_start(source, chunk)
    keys = [key for key, *_ in settings.diff(start.config, config)]
    if counted := [key for key in keys if key in COUNTED_IN]:
        raise UserError(
            f"--fork cannot change {' and '.join(counted)} of {source.path}: its steps are counted in such iterations",
            EXIT_CONFIG,
        )
    idle = "this only matters at a run's start"
    changed = [
        f"{phrase} ({idle})" if phrase.split()[0] in ONLY_AT_THE_START else phrase
        for phrase in difference(start.config, config, NO_CHANGE)
    ]
    return start._replace(changed=tuple(changed) or ("no setting",))


def origin(source: RunDirectory, start: Start) -> dict[str, Any]:
    """What every checkpoint of the new run says about the old one; plain JSON."""
    return {"run": source.name, "iteration": start.iteration}


def check_origin(run: RunDirectory, start: Start, source: RunDirectory) -> None:
    """Refuse, UserError 2, to go on with `run` where it is no fork of `source`."""
    if dict(start.meta.get("forked") or {}).get("run") != source.name:
        raise UserError(
            f"{run.path} is there already and is no fork of {source.path}: choose another name for --fork",
            EXIT_CONFIG,
        )


def forked_state(start: Start, config: Config, combat: "Combat") -> "TrainState":
    """The state of the checkpoint as the new run goes on from it; leaves [S, ...].

    Seeds and, where it was changed, the learning rate are those of `config`; in a changed
    environment all fights begin anew. UserError 3 names the first arrays that do not fit, and the
    setting.
    """
    import jax

    from dronecombat_jax.combat.fingerprint import MET
    from dronecombat_jax.learn.settle import first_mean
    from dronecombat_jax.selfplay.chunk import init_state

    state = restored_state(start, config, combat)
    template = jax.eval_shape(lambda: init_state(combat))
    if template.selfplay is None:
        state = state.replace(selfplay=None)
    if (template.mean is None) != (state.mean is None):
        state = state.replace(mean=first_mean(config, state.learners))
    changed = {key for key, *_ in settings.diff(start.config, config)}
    reshaped = [key for key in SHAPES if key in changed]
    anew = any(key.startswith(MET) for key in changed)
    kept = lambda whole: whole.replace(env=None) if anew else whole
    match_template(
        kept(template),
        leaves_of(flatten(kept(state))),
        str(start.path),
        f"--fork cannot change {', '.join(reshaped) or 'this'}",
    )
    first = config.train.seed
    state = state.replace(seed=np.arange(first, first + config.train.num_seeds, dtype=np.uint32))
    if "learn.learning_rate" in changed:
        rate = np.full_like(state.learners.learning_rate, config.learn.learning_rate)
        state = state.replace(learners=state.learners.replace(learning_rate=rate))
    if anew:
        env = _new_fights(combat, state)
        flown = jax.tree.map(lambda leaf: np.zeros_like(leaf), state.flown)
        state = state.replace(env=env, flown=flown)
    return state


def _new_fights(combat: "Combat", state: "TrainState") -> Any:
    """Fights about to start for every seed; leaves [S, N, ...]."""
    import jax

    from dronecombat_jax.selfplay.chunk import reset_fights

    return jax.jit(jax.vmap(lambda seed, iteration: reset_fights(combat, seed, iteration)))(
        state.seed, state.iteration
    )
