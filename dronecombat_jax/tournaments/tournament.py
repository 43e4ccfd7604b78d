"""`dronecombat tournament`: read everybody, fly what is missing, rate.

    tournaments/<name>/cells/        what was flown, cell by cell; only ever added to (`cells`)
    tournaments/<name>/result.npz    all of it once complete (`result_file`), and result.json
    tournaments/<name>/flights.json  how they fly, where fights are recorded (`flights`)

Killed or stopped it goes on with the same command; with more checkpoints it flies the new cells
alone.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.analysis.result import Entrant, TournamentResult, tournament_result
from dronecombat_jax.arena.rectangle import Rules
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.fingerprint import digest_of, environment
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.config.starts import AS_TRAINED
from dronecombat_jax.errors import EXIT_STOPPED, EXIT_TOURNAMENT
from dronecombat_jax.files.atomic import cannot_write, sweep
from dronecombat_jax.files.lock import exclusive_lock
from dronecombat_jax.files.rundir import run_path
from dronecombat_jax.files.versions import package_version
from dronecombat_jax.machine import backend
from dronecombat_jax.runs.progress import printable
from dronecombat_jax.tournaments.cells import read_cells
from dronecombat_jax.tournaments.contenders import POLICY_SUFFIX, SCRIPTED_PREFIX
from dronecombat_jax.tournaments.entrants import Field, read_field
from dronecombat_jax.tournaments.flights import record_flights, save_flights
from dronecombat_jax.tournaments.flying import Grid, fly
from dronecombat_jax.tournaments.result_file import save_result
from dronecombat_jax.tournaments.standings import standings_text
from dronecombat_jax.types import ATTACKER, DEFENDER

CELLS_NAME = "cells"
# of both sides: [D, A], which to fly
Cells = Callable[[Sequence[Entrant], Sequence[Entrant]], NDArray[np.bool_]]


def tournament(
    words: Sequence[str],
    rules: Rules,
    *,
    name: str = "",
    every: int = 1,
    untrained: bool = False,
    skip_bad: bool = False,
    allow_mismatch: bool = False,
    root: str = "tournaments",
    cells: Cells | None = None,
    flights: int = 0,
    mjcf: str = "",
    spawn: str = AS_TRAINED,
    about: Mapping[str, Any] | None = None,
) -> int:
    """Fly, or go on with, the tournament of everybody whom `words` name; returns an exit code.

    Of runs `every` n-th chunk and the last take part, and with `untrained` also whom they began
    with. `cells` chooses the cells to be flown (default: all); what was flown before is part of the
    result in any case. `about`: plain JSON for `result.json`, too. `flights`: how many fights of
    each run's two sides of one chunk are recorded. `mjcf`: the file of the drone or scene to fly,
    instead of where their runs left it. `spawn`: where fights start (`config.starts`). 0: complete; 5: complete but for players who could not be
    read (`skip_bad`); 75: stopped by a signal and saved. Raises UserError: 2 and 3 as `read_field`,
    73 where the folder cannot be written.
    """
    path = run_path(root, name or default_name(words, spawn))
    print("reading and verifying everybody ...", flush=True)
    field = read_field(
        words,
        every=every,
        untrained=untrained,
        skip_bad=skip_bad,
        allow_mismatch=allow_mismatch,
        mjcf=mjcf,
        spawn=spawn,
    )
    defenders, attackers = ([seat.entrant for seat in side] for side in field.seats)
    combat = Combat(field.config)
    met = environment(field.config, combat.scene)  # as it is flown, whatever becomes of its files
    with claim(path) as folder:
        context = context_of(met, rules)
        identities = [[entrant.identity for entrant in side] for side in (defenders, attackers)]
        cause, steps = read_cells(
            folder / CELLS_NAME, context, *identities, episodes=rules.episodes
        )
        asked = np.ones(cause.shape[:2], bool) if cells is None else cells(defenders, attackers)
        grid = Grid(folder / CELLS_NAME, context, cause, steps, asked)
        _greet(folder, field, rules, grid)
        players = [[seat.player for seat in side] for side in field.seats]
        if not fly(folder.name, combat, players, rules, grid):
            return EXIT_STOPPED
        if flights:
            print(
                f"recording {flights} fights of each run's two sides of one chunk ...", flush=True
            )
            sides = players[DEFENDER], players[ATTACKER]
            save_flights(
                folder, record_flights(combat, (defenders, attackers), sides, rules, flights)
            )
        winner, control_dt = outcome_table(field.config.game), field.config.control_dt
        result = tournament_result(grid.cause, grid.steps, winner, defenders, attackers, control_dt)
        save_result(
            folder,
            result,
            {
                **_about(field, met, context, result, grid.asked),
                "words": [_lasting(word) for word in words],
                "every": every,
                "untrained": untrained,
                "mjcf": mjcf,
                "spawn": spawn,
                **(about or {}),
            },
        )
        _conclude(folder, result, grid.asked)
    return EXIT_TOURNAMENT if field.bad else 0


def default_name(words: Sequence[str], spawn: str = AS_TRAINED) -> str:
    """A folder's name made of those of the runs and files, or of the scripted pilots where there
    are no others, and of other starts than theirs.
    """
    trained = [
        Path(word).resolve().name.removesuffix(POLICY_SUFFIX)
        for word in words
        if not _scripted(word)
    ]
    names = trained or [word.removeprefix(SCRIPTED_PREFIX) for word in words]
    names += [] if spawn in ("", AS_TRAINED) else [spawn]
    return (
        re.sub(r"[^A-Za-z0-9._-]", "-", "-".join(dict.fromkeys(names)))[:100].lstrip(".")
        or "tournament"
    )


def context_of(met: dict[str, Any], rules: Rules) -> dict[str, Any]:
    """All that an outcome depends on beside the two players; plain JSON. `met`: the environment."""
    config: Any = jax.config
    return {
        "environment_digest": digest_of(met),
        **rules._asdict(),
        "generator": str(config.jax_default_prng_impl),
        "partitionable": bool(config.jax_threefry_partitionable),
    }


@contextmanager
def claim(folder: Path) -> Iterator[Path]:
    """The tournament's folder, made where it is not there, for this process alone."""
    try:
        (folder / CELLS_NAME).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error
    with exclusive_lock(folder):
        for place in (folder, folder / CELLS_NAME):
            sweep(place)
        yield folder


def _greet(folder: Path, field: Field, rules: Rules, grid: Grid) -> None:
    print("\n".join(backend.banner()))
    for line in (
        *(f"note: {notice}" for notice in field.notices),
        *(f"skipped: {line}" for line in field.bad),
    ):
        print(printable(line))
    defenders, attackers, episodes = grid.cause.shape
    drawn = ", drawn actions" if rules.stochastic else ""
    cells = int(grid.asked.sum())
    done = int((grid.flown & grid.asked).sum()) * episodes
    before = f"; {done:,} were flown before" if done else ""
    shape = f"{defenders} defenders x {attackers} attackers"
    part = (
        f"{shape} x {episodes}"
        if grid.asked.all()
        else f"{shape}, {cells:,} of these pairs x {episodes}"
    )
    print(f"tournament {folder}: {part} = {cells * episodes:,} fights{drawn}{before}", flush=True)


def _about(
    field: Field,
    met: dict[str, Any],
    context: dict[str, Any],
    result: TournamentResult,
    asked: NDArray,
) -> dict[str, Any]:
    """What the result says beside its entrants; plain JSON."""
    return {
        "package": package_version(),
        "jax": jax.__version__,
        **context,
        "environment": met,
        "fights": int(result.counts.sum()),
        "pairs_asked": int(asked.sum()),
        "missing": list(field.bad),
        "notices": [*field.notices, *_part(result, asked)],
    }


def _part(result: TournamentResult, asked: NDArray) -> list[str]:
    """A line that says how many cells were left out on purpose; none where all are flown."""
    left = int((~result.played & ~asked).sum())
    return (
        [f"{left:,} of {asked.size:,} cells were left out on purpose: no comparison needs them"]
        if left
        else []
    )


def _conclude(folder: Path, result: TournamentResult, asked: NDArray) -> None:
    print(standings_text(result))
    if absent := int((~result.played & asked).sum()):
        print(f"{absent:,} of {asked.sum():,} cells are missing: their players could not be read")
    print(f"written to {folder}", flush=True)


def _lasting(word: str) -> str:
    """The word with its whole path, so that a report finds it from any folder."""
    return str(Path(word).resolve()) if Path(word).exists() else word


def _scripted(word: str) -> bool:
    return word.startswith(SCRIPTED_PREFIX)
