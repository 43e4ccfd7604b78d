"""Where a run goes on from: its newest good checkpoint, the settings that made it, and whether they still hold.

Everything is read from the checkpoint itself; `config.toml` serves where a checkpoint does not say. What does
not live here: starting another run from a checkpoint (`fork`). Needs no JAX until a state is restored.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from dronecombat_jax import settings
from dronecombat_jax.config import Config
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA, UserError
from dronecombat_jax.runs import checkpoint, metrics
from dronecombat_jax.runs.rundir import RunDirectory
from dronecombat_jax.schema import shown

if TYPE_CHECKING:
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.types import TrainState

NO_CHANGE = ("train.total_steps", "run.")  # settings that make no other run
# Settings that may change when a run goes on; every other one makes it a different run. A scene's
# file may have been moved: what it says is compared as the environment (`provenance`).
MAY_CHANGE = (*NO_CHANGE, "sim.mjcf")


class Start(NamedTuple):
    """A checkpoint to go on from."""

    checkpoints: Path
    iteration: int  # its step
    config: Config  # it was made with
    meta: dict[str, Any]
    changed: tuple[str, ...] = ()  # settings that a fork changes, one line each; empty where a run goes on

    @property
    def path(self) -> Path:
        """The folder of the checkpoint."""
        return self.checkpoints / str(self.iteration)


def find_start(run: RunDirectory, config: Config) -> Start | None:
    """The newest good checkpoint of a run that is claimed; None for a new run.

    Raises UserError 2 where `config` changes what may not change, 3 where checkpoints there were, but none is good.
    """
    iteration = checkpoint.latest(run.checkpoints)
    if iteration is None:
        _refuse_lost(run)
        return None
    start = read_start(run, iteration)
    if changed := difference(start.config, config):
        raise UserError(
            f"run {run.path} was made with other settings: {'; '.join(changed)}. "
            "Choose another --name, the old settings, or --fork NEW_NAME to go on from here with the new ones",
            EXIT_CONFIG,
        )
    return start


def read_start(run: RunDirectory, iteration: int) -> Start:
    """A checkpoint and the settings it was made with; UserError 3 where there is none or it is damaged."""
    meta = checkpoint.read_meta(run.checkpoints, iteration)
    text = meta.get("config")
    if not isinstance(text, str):  # as in a checkpoint that was written by hand
        return Start(run.checkpoints, iteration, settings.load(run.config), meta)
    try:
        config = settings.from_toml(text, str(run.checkpoints / str(iteration)))
    except UserError as error:
        message = f"the settings in a checkpoint cannot be read by this version: {error.message.splitlines()[0]}"
        raise UserError(message, EXIT_DATA) from None
    return Start(run.checkpoints, iteration, config, meta)


def newest_start(run: RunDirectory, chunk: int | None = None) -> Start:
    """For readers, who hold no lock: the newest good checkpoint or that of `chunk` (0: untrained). UserError 3."""
    newest = checkpoint.latest(run.checkpoints, set_aside=False)
    if newest is None:
        raise UserError(f"{run.checkpoints}: no checkpoint that can be used", EXIT_DATA)
    start = read_start(run, newest)
    return start if chunk is None else read_start(run, chunk * start.config.train.chunk_iterations)


def difference(
    stored: Config,
    config: Config,
    apart_from: tuple[str, ...] = MAY_CHANGE,
) -> list[str]:
    """What `config` changes of a run made with `stored`, one phrase for each setting.

    `apart_from`: what settings begin with that may change without a word.
    """
    return [
        f"{key} was {shown(old)}, now {shown(new)}"
        for key, old, new in settings.diff(stored, config)
        if not key.startswith(apart_from)
    ]


def restored_state(start: Start, config: Config, combat: "Combat") -> "TrainState":
    """The state of the checkpoint, NumPy leaves [S, ...], with pools as long as `config` wants them.

    The shapes are those of the settings that the checkpoint was made with. UserError 3 where it does not fit.
    """
    from dronecombat_jax.selfplay.pool import resize

    state = load_state(start, combat)
    if state.selfplay is None or config.num_chunks == start.config.num_chunks:
        return state
    return state.replace(selfplay=resize(state.selfplay, config.num_chunks))


def load_state(start: Start, combat: "Combat") -> "TrainState":
    """The state as it was saved, NumPy leaves [S, ...]; `combat` lends its scene. UserError 3 where it does not fit."""
    import jax

    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.selfplay.chunk import init_state

    then = Combat(start.config, combat.scene)
    template = jax.eval_shape(lambda: init_state(then))
    return checkpoint.restore(start.checkpoints, start.iteration, template, hint="was it written by another version?")


def _refuse_lost(run: RunDirectory) -> None:
    """Refuse to begin anew where a run has been: its metrics and what is left of its checkpoints would be lost."""
    aside = sorted(path.name for path in run.checkpoints.glob("damaged-*"))
    unusable = [str(step) for step in checkpoint.steps(run.checkpoints)]
    if not aside and not unusable and not _has_records(run.metrics):
        return  # nothing but what a run leaves that was killed before its first checkpoint
    found = [f"{', '.join(unusable[:5])} cannot be used"] if unusable else []
    found += [f"the damaged ones were set aside as {', '.join(aside[:5])}"] if aside else []
    raise UserError(
        f"{run.checkpoints}: no checkpoint to go on from ({'; '.join(found) or 'they are gone'}); nothing else was touched. "
        f"To start anew choose another --name, or move {run.path} away",
        EXIT_DATA,
    )


def _has_records(path: Path) -> bool:
    try:
        return path.exists() and bool(metrics.read(path))
    except UserError:  # damaged lines were records once
        return True
