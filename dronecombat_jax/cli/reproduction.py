"""The steps of the paper's experiment, in order; what is finished is not done again.

    reproductions/<name>/runs/ippo, runs/sippo      both trainings, both agents of every chunk
    reproductions/<name>/tournaments/all            their fights, and report/ with the claims
    reproductions/<name>/steps.json                 which steps are finished, and by what they were

Each step is what a command does by itself (train, tournament, report), and goes on where a signal
or a kill has stopped it. A step whose settings have changed is entered again. JAX is imported by
the steps alone.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from dronecombat_jax.config import settings
from dronecombat_jax.config.costs import Cost
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.scales import Scale
from dronecombat_jax.files.atomic import cannot_write, sweep, write_atomic
from dronecombat_jax.files.lock import exclusive_lock
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.files.versions import package_version

FINISHED_NAME = "steps.json"
TOURNAMENT_NAME = "all"
ANCHORS = "scripted:all"
METHOD_OF_RUN = {"ippo": "ippo", "sippo": "s-ippo"}


class Step(NamedTuple):
    """One piece of the experiment."""

    name: str
    seconds: float  # estimated
    key: str  # digest of all that decides its outcome
    output: Path  # is there once the step is finished
    work: Callable[[], int]  # returns an exit code


def steps_of(scale: Scale, configs: Mapping[str, Config], cost: Cost, folder: Path) -> list[Step]:
    """All steps, in order."""
    steps = []
    for name, config in configs.items():
        last = config.num_chunks * config.train.chunk_iterations
        output = RunDirectory(folder / "runs" / name).checkpoints / str(last)
        key = _digest(settings.to_toml(_anywhere(config)))
        steps.append(
            Step(f"train {name}", cost.trainings[name], key, output, partial(_train, config))
        )
    tournament = folder / "tournaments" / TOURNAMENT_NAME
    key = _digest([step.key for step in steps], scale.episodes, scale.every)
    fly = partial(_fly, scale, [str(folder / "runs" / name) for name in configs], folder)
    steps.append(Step("tournament", cost.tournament, key, tournament / "result.npz", fly))
    page = tournament / "report" / "report.html"
    key = _digest(key, package_version())
    steps.append(Step("report", cost.report, key, page, partial(_report, tournament)))
    return steps


def finished(steps: list[Step], folder: Path) -> list[bool]:
    """Which steps are done, as their settings are now, and still have what they made."""
    known = _read(folder)
    return [known.get(step.name) == step.key and step.output.exists() for step in steps]


def note_finished(step: Step, folder: Path) -> None:
    """Remember that a step is done. UserError 73 where that cannot be written."""
    known = {**_read(folder), step.name: step.key}
    write_atomic(folder / FINISHED_NAME, json.dumps(known, indent=1) + "\n")


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """The experiment's folder, made where it is not there, for this process alone.

    UserError 73 where it cannot be made, or another process works on it.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error
    with exclusive_lock(folder):
        sweep(folder)
        yield


def _train(config: Config) -> int:
    from dronecombat_jax.runs import training
    from dronecombat_jax.watch import finish

    code = training.train(config)
    if not code:
        finish.finish(config)
    return code


def _fly(scale: Scale, runs: list[str], folder: Path) -> int:
    from dronecombat_jax.analysis.panel import cross_play_cells
    from dronecombat_jax.arena.rectangle import Rules
    from dronecombat_jax.tournaments import tournament as tournaments

    return tournaments.tournament(
        [*runs, ANCHORS],
        Rules(scale.episodes),
        name=TOURNAMENT_NAME,
        root=str(folder / "tournaments"),
        cells=partial(cross_play_cells, every=scale.every),
        about={"by": "method", "methods": METHOD_OF_RUN, "panel_every": scale.every},
    )


def _report(tournament: Path) -> int:
    from dronecombat_jax.report import tournament_report
    from dronecombat_jax.watch.pairs import fights_page

    for part in (".", "tables", "figures"):  # what a kill left half written
        sweep(tournament / "report" / part)
    fights = partial(fights_page, say=lambda text: print(text, flush=True))
    return tournament_report.report(str(tournament), None, fights)


def _anywhere(config: Config) -> Config:
    """The settings without those that say where a run is computed and kept: these may change
    between two steps.
    """
    return replace(config, run=replace(config.run, device="auto", directory="runs"))


def _read(folder: Path) -> dict[str, Any]:
    """What is noted as finished; nothing where the file is not there or damaged."""
    try:
        known = json.loads((folder / FINISHED_NAME).read_text())
    except (OSError, ValueError):
        return {}
    return known if isinstance(known, dict) else {}


def _digest(*parts: Any) -> str:
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()
