"""Fresh best responses to one frozen policy: the run that trains them, as settings.

    runs/NAME/exploit/defender-34-x4/              the responders, a run of four seeds
    runs/NAME/exploit/defender-34.safetensors      whom they train against
    runs/NAME/exploit/defender-34-x4-best.safetensors    the best of them

Responders learn with the settings of the run that is exploited, from nothing, and meet nobody but
the frozen policy. What does not live here: their fights and the verdict (`exploit`). Needs no JAX.
"""

import re
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config, RunConfig, SelfPlayConfig
from dronecombat_jax.config.opponents import SCRIPTED
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.files.rundir import RunDirectory, find_run
from dronecombat_jax.runs.resume import newest_start

FOLDER = "exploit"
POINTS = 12  # of the curve over the budget, at most: so many checkpoints stay
FIRST_SEED = 1000  # of responders: none of the run's own
PRESET = "duel"  # of responders to somebody who is no run
SUFFIX = ".safetensors"
_PILOTS = "pilots:"


class Wanted(NamedTuple):
    """What is asked for, as on the command line."""

    word: str  # RUN, a policy file, pilots:NAME or scripted:NAME
    role: str = "defender"  # whose policy is exploited; the other side responds
    budget: float = 20e6  # environment steps of each responder
    restarts: int = 4  # responders
    fights: int = 1024  # that count
    chunk: int | None = None  # of the run; None: the newest
    run_seed: int | None = None  # of the run's seeds; None: the first
    seed: int = 0
    preset: str = ""  # of the responders; "": the settings of the run, or `PRESET`
    device: str = "auto"


class Plan(NamedTuple):
    """The responders' training, and who is exploited."""

    wanted: Wanted
    config: Config  # of the responders' run
    run: RunDirectory | None  # that is exploited; None: somebody who is no run
    chunk: int  # of that run
    run_seed: int

    @property
    def folder(self) -> RunDirectory:
        """Where the responders live."""
        return RunDirectory(Path(self.config.run.directory) / self.config.run.name)

    @property
    def policy_file(self) -> Path | None:
        """The frozen policy, to be exported before the training begins; None where it is named."""
        return Path(self.config.selfplay.opponents.partition("=")[2]) if self.run else None

    @property
    def result(self) -> Path:
        """The result as JSON; the picture is beside it."""
        return self.folder.path.with_suffix(".json")

    @property
    def best(self) -> Path:
        """The policy file of the best responder."""
        return self.folder.path.with_name(f"{self.folder.path.name}-best{SUFFIX}")


def plan(wanted: Wanted) -> Plan:
    """The training of the responders to `wanted`.

    UserError: 2 for settings that cannot be trained, 3 where there is no such run.
    """
    if wanted.word.startswith((SCRIPTED, _PILOTS)) or wanted.word.endswith(SUFFIX):
        base = settings.load(wanted.preset or PRESET)
        name = re.sub(r"[^A-Za-z0-9_-]+", "-", Path(wanted.word).name.removesuffix(SUFFIX))
        home = Path(RunConfig().directory) / FOLDER
        return Plan(wanted, _responders(base, wanted, home, name, wanted.word), None, -1, -1)
    run = RunDirectory(find_run(wanted.word))
    start = newest_start(run, wanted.chunk)
    config, train = start.config, start.config.train
    run_seed = train.seed if wanted.run_seed is None else wanted.run_seed
    if not train.seed <= run_seed < train.seed + train.num_seeds:
        last = train.seed + train.num_seeds - 1
        raise UserError(f"{run.path} has seeds {train.seed} to {last}, not {run_seed}", EXIT_CONFIG)
    chunk = start.iteration // train.chunk_iterations
    name = f"{wanted.role}-{chunk}" + (f"-seed{run_seed}" if train.num_seeds > 1 else "")
    base = settings.load(wanted.preset) if wanted.preset else config
    file = run.path / FOLDER / f"{name}{SUFFIX}"
    responders = _responders(base, wanted, file.parent, name, str(file))
    return Plan(wanted, responders, run, chunk, run_seed)


def _responders(base: Config, wanted: Wanted, home: Path, name: str, word: str) -> Config:
    """The settings of the responders' run: those of `base`, against `word` alone."""
    parts = [name, f"x{wanted.restarts}", Path(wanted.preset).name.removesuffix(".toml")]
    name = "-".join(filter(None, [*parts, f"s{wanted.seed}" if wanted.seed else ""]))
    kept = home / name / "config.toml"
    if kept.is_file():  # it goes on, wherever it lies now
        word = settings.load(kept).selfplay.opponents.partition("=")[2]
    opponents = SelfPlayConfig(opponents=f"{wanted.role}={word}")
    train = replace(
        base.train,
        total_steps=int(wanted.budget),
        num_seeds=wanted.restarts,
        seed=FIRST_SEED * (1 + wanted.seed),
    )
    run = RunConfig(
        name=name,
        directory=str(home),
        device=wanted.device,  # pyright: ignore[reportArgumentType]
        matmul_precision=base.run.matmul_precision,
        figures=False,
        video=False,
        replay=False,
    )
    config = replace(base, selfplay=opponents, train=train, run=run)
    every = -(-config.num_chunks // POINTS)
    run = replace(run, keep="all" if every == 1 else f"every {every}")
    return settings.checked(replace(config, run=run))
