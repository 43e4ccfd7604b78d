"""Weights & Biases: the records of `metrics.jsonl` for a project of the user's, where `run.wandb`
says so.

The package is an extra and is imported here alone. `metrics.jsonl` stays the record: what goes
wrong here while a run trains is warned of once, and the training goes on. A run is the same one
there each time it goes on: its id lies in `wandb/dronecombat-id` in its folder.
"""

import importlib
import logging
import math
import os
import secrets
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.preflight import NO_WANDB, has_wandb
from dronecombat_jax.config.schema import flatten, one_line
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.files.atomic import cannot_write, write_atomic

PROJECT = "dronecombat"  # unless WANDB_PROJECT names another
_ID = "dronecombat-id"
_log = logging.getLogger(__name__)


class WandbLog:
    """One run of Weights & Biases; numbers on the axis of environment steps."""

    def __init__(self, folder: Path, config: Config):
        """`folder`: the run's, where offline records go.

        Raises UserError 2 where the package is missing or does not start, such as without an
        account; 73 where the folder cannot be written.
        """
        mode = config.run.wandb
        if not has_wandb():
            raise UserError(f"run.wandb = {mode}: {NO_WANDB}", EXIT_CONFIG)
        wandb: Any = importlib.import_module("wandb")
        self._prefixed = config.train.num_seeds > 1
        try:
            self._run: Any = wandb.init(
                project=os.environ.get("WANDB_PROJECT", PROJECT),
                name=config.run.name,
                id=_identity(folder),
                dir=str(folder),
                config=flatten(config),
                mode=mode,
                resume="allow",
                # stdout belongs to the commands, and nothing of the user's code leaves the machine
                settings=wandb.Settings(
                    silent=True, console="off", disable_git=True, disable_code=True
                ),
            )
            self._run.define_metric("*", step_metric="steps")
        except Exception as error:  # it raises whatever a network or an account can
            reason = one_line(" ".join(str(error).split()) or type(error).__name__)
            raise UserError(
                f"run.wandb = {mode}: Weights & Biases did not start: {reason}; "
                "offline needs no account, off nothing at all",
                EXIT_CONFIG,
            ) from error

    def add(self, record: Mapping[str, Any]) -> None:
        """Log the numbers of one record, which has "steps" and "seed"; of several seeds each under
        `seed-N/`.
        """
        prefix = f"seed-{record['seed']}/" if self._prefixed else ""
        numbers = {
            f"{prefix}{key}": value
            for key, value in record.items()
            if isinstance(value, int | float)
            and math.isfinite(value)
            and key not in ("steps", "seed")
        }
        self._attempt(lambda run: run.log({"steps": record["steps"], **numbers}))

    def close(self) -> None:
        """Finish the run there; may be called twice."""
        self._attempt(lambda run: run.finish())
        self._run = None

    def _attempt(self, action: Callable[[Any], Any]) -> None:
        if self._run is None:
            return
        try:
            action(self._run)
        except Exception as error:
            self._run = None
            reason = one_line(" ".join(str(error).split()))
            _log.warning("Weights & Biases hears no more of this run: %s", reason)


def _identity(folder: Path) -> str:
    """The run's id there, made when it is first asked for."""
    path = folder / "wandb" / _ID
    try:
        path.parent.mkdir(exist_ok=True)
        if not path.exists():
            write_atomic(path, secrets.token_hex(8))
        return path.read_text().strip()
    except OSError as error:
        raise cannot_write(path, error) from error
