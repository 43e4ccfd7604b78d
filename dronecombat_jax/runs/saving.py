"""Saving a run's state through trouble: a disk that refuses once, a directory that has gone."""

from typing import Any

from dronecombat_jax.config import settings
from dronecombat_jax.config.estimates import KEPT_ANYWAY, keep_rule
from dronecombat_jax.config.fields import Config
from dronecombat_jax.errors import EXIT_CANNOT_WRITE, UserError
from dronecombat_jax.files import checkpoint
from dronecombat_jax.files.atomic import write_atomic
from dronecombat_jax.files.claim import rescue_run, still_there
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.runs.opponents import Frozen, keep
from dronecombat_jax.runs.past_players import Players, filled_slots
from dronecombat_jax.runs.progress import Progress
from dronecombat_jax.runs.provenance import describe


class Saver:
    """Saves at chunk boundaries.

    A disk that refuses is forgiven once; a directory that has gone is replaced.
    """

    def __init__(
        self, run: RunDirectory, config: Config, progress: Progress, more_meta: dict[str, Any]
    ):
        """`more_meta`: plain JSON for every checkpoint, beside what `provenance` says."""
        self.run, self.config, self.progress, self.more_meta = run, config, progress, more_meta
        self.refused: UserError | None = None
        self._players = Players(run.checkpoints)
        self.met: dict[str, Any] | None = None  # the environment that is flown, once it is loaded
        self.frozen: Frozen | None = None  # the policies that it trains against

    def save(self, state: Any) -> None:
        """Save `state` (NumPy leaves); the step is the number of iterations done.

        Raises UserError 73 where the disk refuses twice running, 4 where the state is not finite.
        """
        if not still_there(self.run):
            self.run = rescue_run(self.run)
            self._players = Players(self.run.checkpoints)
            self.progress.message(
                f"the run's directory has gone; checkpoints go to {self.run.path} from now on"
            )
            write_atomic(self.run.config, settings.to_toml(self.config))
            if self.frozen is not None:
                keep(self.run, self.frozen)
        try:
            self.save_now(state)
            self._remove_others(int(state.iteration[0]))
            self.refused = None
        except UserError as error:
            if error.exit_code != EXIT_CANNOT_WRITE or self.refused is not None:
                raise
            self.refused = error
            self.progress.message(f"warning: {error.message}; trying again at the next save")

    def save_now(self, state: Any) -> None:
        """Save or raise: a run's first checkpoint, without which it must not start."""
        iteration = int(state.iteration[0])
        meta = describe(self.config, iteration, self.met) | self.more_meta
        filled = filled_slots(iteration, self.config.train.chunk_iterations)
        state, roster = self._players.store(state, filled)
        checkpoint.save(self.run.checkpoints, iteration, state, meta, players=roster)

    def _remove_others(self, iteration: int) -> None:
        """Remove the checkpoints that `run.keep` does not ask for; `iteration`: the newest."""
        word, number = keep_rule(self.config.run.keep) or ("all", 1)
        if word == "all":
            return
        steps = [step for step in checkpoint.steps(self.run.checkpoints) if step <= iteration]
        newest = set(steps[-max(number if word == "last" else 0, KEPT_ANYWAY) :])
        every = number * self.config.train.chunk_iterations
        for step in steps:
            if step not in newest and (word == "last" or step % every):
                checkpoint.remove(self.run.checkpoints, step)

    def finish(self) -> None:
        """Raise the error of a save that was refused, if no later save has succeeded."""
        if self.refused is not None:
            raise self.refused
