"""What a Python program or a notebook needs: `from dronecombat_jax import train, load_run, ...`.

The same as the commands, with Python's values. Raises UserError where a command would print a line.
What does not live here: the work itself; these functions call the other rooms.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.starts import AS_TRAINED
from dronecombat_jax.errors import EXIT_STOPPED, EXIT_TOURNAMENT, UserError
from dronecombat_jax.files.rundir import find_run, run_path
from dronecombat_jax.machine import backend
from dronecombat_jax.machine.start import prepare_training

if TYPE_CHECKING:
    from dronecombat_jax.analysis.result import TournamentResult
    from dronecombat_jax.policies.file import SavedPolicy
    from dronecombat_jax.runs.evaluation import SavedRun
    from dronecombat_jax.tournaments.newcomers import Rated


def load_config(preset: str = "duel", changes: Mapping[str, Any] | None = None) -> Config:
    """The settings of a preset or a TOML file, with `changes` by dotted key.

    Such as `load_config("duel", {"train.seed": 3, "train.total_steps": 5_000_000})`. Raises
    UserError with a line for each mistake.
    """
    return settings.load(preset, dict(changes or {}))


def prepare(device: str = "auto", cpu_devices: int = 1) -> None:
    """Settle what JAX and MuJoCo read from the environment; does nothing where JAX is imported
    already.

    The functions here that need JAX call it. `cpu_devices`: how many devices a CPU pretends to be.
    """
    if "jax" not in sys.modules:
        backend.prepare(device, cpu_devices)


def train(
    config: Config | str = "duel", changes: Mapping[str, Any] | None = None, *, finish: bool = True
) -> Path:
    """Train, or go on with, a run, as `dronecombat train`; returns the run's directory.

    `config`: settings, or a preset's name. `changes`: settings by dotted key. `finish`: also draw,
    evaluate and film. A run that is stopped is saved, and raises KeyboardInterrupt; the same call
    goes on. Raises UserError: 2 for settings, 3 for checkpoints, 4 where training diverged, 73 for
    the disk.
    """
    if isinstance(config, str):
        whole = settings.as_run(load_config(config, changes), config)
    elif changes:
        raise UserError("changes go with a preset's name: a Config holds all of its settings")
    else:
        whole = settings.as_run(config, "custom")
    if "jax" not in sys.modules:
        prepare_training(whole)
    from dronecombat_jax.runs import training
    from dronecombat_jax.watch.finish import finish as draw

    if training.train(whole) == EXIT_STOPPED:
        raise KeyboardInterrupt("stopped and saved; the same call goes on")
    if finish:
        draw(whole)
    return Path(whole.run.directory) / whole.run.name


def load_run(run: Path | str, chunk: int | None = None) -> "SavedRun":
    """A run's settings, environment and state after `chunk` chunks (0: untrained, None: newest).

    `run`: its directory, or its name in runs/. Raises UserError 3 where it cannot be read.
    """
    prepare()
    from dronecombat_jax.runs import evaluation

    return evaluation.load_run(find_run(str(run)), chunk)


def load_policy(path: Path | str) -> "SavedPolicy":
    """A policy file (.safetensors): `policy`, NumPy leaves, and `info`. Raises UserError 3."""
    prepare()
    from dronecombat_jax.policies import file

    return file.load_policy(Path(path))


def tournament(
    entrants: Sequence[Path | str],
    *,
    episodes: int = 5,
    seed: int = 0,
    name: str = "",
    every: int = 1,
    root: str = "tournaments",
    spawn: str = AS_TRAINED,
) -> "TournamentResult":
    """Fly, or go on with, the round robin of all attackers against all defenders.

    `entrants`: runs, policy files, `scripted:NAME` or `scripted:all`; `episodes`: fights of a pair;
    `every`: of a run every n-th chunk, and the last; `spawn`: where they start (`config.starts`). Its
    folder is `root`/`name`. Raises UserError, and KeyboardInterrupt where it was stopped: the same
    call goes on.
    """
    prepare()
    from dronecombat_jax.arena.rectangle import Rules
    from dronecombat_jax.tournaments import tournament as flown
    from dronecombat_jax.tournaments.result_file import load_result

    words = [str(word) for word in entrants]
    name = name or flown.default_name(words)
    how = {"name": name, "every": every, "root": root, "spawn": spawn}
    code = flown.tournament(words, Rules(episodes, seed), **how)
    if code not in (0, EXIT_TOURNAMENT):
        raise KeyboardInterrupt("stopped and saved; the same call goes on")
    return load_result(run_path(root, name))


def rate(
    policy: Path | str,
    *,
    role: str = "",
    fights: int = 0,
    allow_env_mismatch: bool = False,
    spawn: str = AS_TRAINED,
) -> "list[Rated]":
    """Rate a policy on the ladder that comes with the package, as `dronecombat rate`.

    `policy`: a policy file, a run (the newest of both sides and all seeds), `pilots:NAME` or
    `scripted:NAME`. `role`: "defender" or "attacker" alone. `fights` against each opponent; 0: as
    many as the ladder's own; `spawn`: on the ladder from rest, "as_trained", or from "even" starts.
    Raises UserError 2 and 3.
    """
    prepare()
    from dronecombat_jax.tournaments import newcomers

    return newcomers.rate(
        str(policy), role=role, fights=fights, allow_mismatch=allow_env_mismatch, spawn=spawn
    )


def exploit(
    run: Path | str,
    *,
    role: str = "defender",
    budget: float = 20e6,
    restarts: int = 4,
    fights: int = 1024,
    chunk: int | None = None,
    run_seed: int | None = None,
    preset: str = "",
    seed: int = 0,
) -> dict[str, Any]:
    """How far fresh best responses get against one side's policy, as `dronecombat exploit`.

    `run`: a run, a policy file, `pilots:NAME` or `scripted:NAME`; `budget`: environment steps of each
    of `restarts` responders. Returns what the result file holds. Raises UserError, and
    KeyboardInterrupt where it was stopped: the same call goes on.
    """
    from dronecombat_jax.runs.responders import Wanted, plan

    wanted = Wanted(str(run), role, budget, restarts, fights, chunk, run_seed, seed, preset)
    planned = plan(wanted)
    if "jax" not in sys.modules:
        prepare_training(planned.config)
    from dronecombat_jax.watch.best_responses import respond

    code, result = respond(planned)
    if code == EXIT_STOPPED:
        raise KeyboardInterrupt("stopped and saved; the same call goes on")
    return result
