"""Where a run goes on from: its newest good checkpoint, the settings that made it, and whether they
still hold.

Everything is read from the checkpoint itself; `config.toml` serves where a checkpoint does not say.
What does not live here: starting another run from a checkpoint (`fork`). Needs no JAX until a state
is restored.
"""

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dronecombat_jax.config import body_file, settings
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.schema import shown
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA, UserError
from dronecombat_jax.files import checkpoint, metrics
from dronecombat_jax.files.arrays import Arrays
from dronecombat_jax.files.manifest import CheckpointError, Manifest, Roster
from dronecombat_jax.files.rundir import RunDirectory

if TYPE_CHECKING:
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.types import TrainState

_log = logging.getLogger(__name__)

NO_CHANGE = ("train.total_steps", "run.")  # settings that make no other run
# Settings that may change when a run goes on; every other one makes it a different run. A scene's
# file may have been moved: what it says is compared as the environment (`provenance`).
MAY_CHANGE = (*NO_CHANGE, "sim.mjcf")


class Start(NamedTuple):
    """A checkpoint to go on from. It has been verified."""

    checkpoints: Path
    manifest: Manifest
    config: Config  # it was made with
    # settings that a fork changes, one line each; empty where a run goes on
    changed: tuple[str, ...] = ()
    members: list[Arrays] | None = None  # its past players, where they have been read

    @property
    def iteration(self) -> int:
        """Its step."""
        return self.manifest.step

    @property
    def meta(self) -> dict[str, Any]:
        """What was saved beside the arrays."""
        return self.manifest.meta

    @property
    def path(self) -> Path:
        """The folder of the checkpoint."""
        return self.checkpoints / str(self.iteration)


def find_start(run: RunDirectory, config: Config) -> Start | None:
    """The newest good checkpoint of a run that is claimed; None for a new run.

    Raises UserError 2 where `config` changes what may not change, 3 where checkpoints there were,
    but none is good.
    """
    start = _newest_with_players(run)
    if start is None:
        _refuse_lost(run)
        return None
    if changed := difference(start.config, config):
        raise UserError(
            f"run {run.path} was made with other settings: {'; '.join(changed)}. "
            "Choose another --name, the old settings, or --fork NEW_NAME to go on from here with the new ones",
            EXIT_CONFIG,
        )
    return start


def read_start(run: RunDirectory, saved: int | Manifest) -> Start:
    """A checkpoint and the settings it was made with; UserError 3 where there is none or it is
    damaged.

    `saved`: its step, or its manifest where it has been verified already.
    """
    manifest = saved if isinstance(saved, Manifest) else checkpoint.verify(run.checkpoints, saved)
    text = manifest.meta.get("config")
    if not isinstance(text, str):  # as in a checkpoint that was written by hand
        return Start(run.checkpoints, manifest, settings.load(run.config))
    try:
        config = settings.from_toml(text, str(run.checkpoints / str(manifest.step)))
    except UserError as error:
        message = f"the settings in a checkpoint cannot be read by this version: {error.message.splitlines()[0]}"
        raise UserError(message, EXIT_DATA) from None
    return Start(run.checkpoints, manifest, config)


def newest_start(run: RunDirectory, chunk: int | None = None) -> Start:
    """For readers, who hold no lock: the newest good checkpoint or that of `chunk` (0: untrained).
    UserError 3.
    """
    newest = checkpoint.latest(run.checkpoints, set_aside=False)
    if newest is None:
        raise UserError(f"{run.checkpoints}: no checkpoint that can be used", EXIT_DATA)
    start = read_start(run, newest)
    step = start.iteration if chunk is None else chunk * start.config.train.chunk_iterations
    return start if step == start.iteration else read_start(run, step)


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
        if not key.startswith(apart_from) and not _moved(key, old, new)
    ]


def _moved(key: str, old: Any, new: Any) -> bool:
    """Whether it is another place of a body's file; what it says is compared as the environment."""
    return key == "sim.body" and body_file.is_file(old) and body_file.is_file(new)


def restored_state(start: Start, config: Config, combat: "Combat") -> "TrainState":
    """The state of the checkpoint, NumPy leaves [S, ...], with pools as long as `config` wants
    them.

    The shapes are those of the settings that the checkpoint was made with. UserError 3 where it
    does not fit.
    """
    from dronecombat_jax.selfplay.pool import resize

    state = load_state(start, combat)
    if state.selfplay is None or config.num_chunks == start.config.num_chunks:
        return state
    return state.replace(selfplay=resize(state.selfplay, config.num_chunks))


def load_state(start: Start, combat: "Combat", *, pools: bool = True) -> "TrainState":
    """The state as it was saved, NumPy leaves [S, ...]; `combat` lends its scene. UserError 3 where
    it does not fit.

    Without `pools` they may be empty: who reads policies needs no past players.
    """
    import jax

    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.runs.past_players import Players, emptied, with_players
    from dronecombat_jax.selfplay.chunk import init_state

    then, manifest = Combat(start.config, combat.scene), start.manifest
    template = jax.eval_shape(lambda: init_state(then))
    roster = manifest.players
    if roster is not None and template.selfplay is not None:
        template = template.replace(selfplay=emptied(template.selfplay))
    if old := not any(leaf.path.startswith("flown/") for leaf in manifest.leaves):
        template = template.replace(flown=None)
    state = checkpoint.restore(
        start.checkpoints, manifest, template, hint="was it written by another version?"
    )
    if roster is not None and pools:
        members = (
            Players(start.checkpoints).read(roster) if start.members is None else start.members
        )
        state = state.replace(selfplay=with_players(state.selfplay, members))
    return brought_up_to_date(state, start.config) if old else state


def brought_up_to_date(state: "TrainState", config: Config) -> "TrainState":
    """The state of a checkpoint from before fights were followed, and from before log-std was kept
    in its bounds.
    """
    import jax

    from dronecombat_jax.selfplay import tally

    bound = lambda log_std: np.clip(log_std, config.learn.least_log_std, config.learn.max_log_std)
    parameters, selfplay = state.learners.parameters, state.selfplay
    parameters = parameters.replace(log_std=bound(parameters.log_std))
    if selfplay is not None:
        old: Any = selfplay.pools  # of one policy each: there were no teams yet
        pools = (
            pool
            and pool.replace(policies=pool.policies.replace(log_std=bound(pool.policies.log_std)))
            for pool in old
        )
        selfplay = selfplay.replace(pools=tuple(pools))
    shape = state.env.clock.shape[:1]  # [S]
    unknown = jax.device_get(tally.unknown(config.train.num_envs, len(config.game.sides)))
    flown = jax.tree.map(lambda leaf: np.broadcast_to(leaf, (*shape, *leaf.shape)).copy(), unknown)
    learners = state.learners.replace(parameters=parameters)
    return state.replace(learners=learners, selfplay=selfplay, flown=flown)


def _newest_with_players(run: RunDirectory) -> Start | None:
    """The newest good checkpoint whose past players are all there, or can be made again; None where
    there is none.
    """
    manifest = checkpoint.latest(run.checkpoints)
    while manifest is not None:
        start = read_start(run, manifest)
        if manifest.players is None:
            return start
        try:
            return start._replace(members=_members(run, start, manifest.players))
        except CheckpointError as error:
            _log.warning("checkpoint %d skipped: %s", manifest.step, error)
        manifest = checkpoint.latest(run.checkpoints, below=manifest.step)
    return None


def _members(run: RunDirectory, start: Start, roster: Roster) -> list[Arrays]:
    """The past players of a checkpoint; a damaged one is made again from its own checkpoint. Raises
    CheckpointError.
    """
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.runs.past_players import Players
    from dronecombat_jax.runs.saved_policies import parameters_of

    players = Players(run.checkpoints)
    try:
        return players.read(roster)
    except CheckpointError as error:
        fault = error
    for slot in players.damaged(roster):
        try:
            then = read_start(run, slot * start.config.train.chunk_iterations)
            state = load_state(then, Combat(then.config), pools=False)
            assert state.selfplay is not None
            players.mend(slot, state.selfplay, parameters_of(state.learners, then.config))
        except UserError:
            raise fault from None
        _log.warning(
            "past player %d made again from checkpoint %d: %s", slot, then.iteration, fault
        )
    return players.read(roster)


def _refuse_lost(run: RunDirectory) -> None:
    """Raise UserError where a run has been in this folder: a new one would destroy its metrics and
    what is left of its checkpoints.
    """
    aside = sorted(path.name for path in run.checkpoints.glob("damaged-*"))
    unusable = [str(step) for step in checkpoint.steps(run.checkpoints)]
    if not aside and not unusable and not _has_records(run.metrics):
        return  # nothing but what a run leaves that was killed before its first checkpoint
    reasons = [f"{', '.join(unusable[:5])} cannot be used"] if unusable else []
    reasons += [f"the damaged ones were set aside as {', '.join(aside[:5])}"] if aside else []
    raise UserError(
        f"{run.checkpoints}: no checkpoint to go on from ({'; '.join(reasons) or 'they are gone'}); nothing else was touched. "
        f"To start anew choose another --name, or move {run.path} away",
        EXIT_DATA,
    )


def _has_records(path: Path) -> bool:
    try:
        return path.exists() and bool(metrics.read(path))
    except UserError:  # damaged lines were records once
        return True
