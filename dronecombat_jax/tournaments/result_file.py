"""The result of a tournament as files: `result.npz` holds all of it, `result.json` tells people
what it is about.

    counts [D, A, C], cause [D, A, E], steps [D, A, E], played [D, A], winner [C], control_dt, about
    (the JSON)

Needs no JAX and no tournament folder: a result file may be sent to somebody else.
"""

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from dronecombat_jax.analysis.result import Alias, Entrant, TournamentResult, tournament_result
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.settings import suggestion
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA, UserError
from dronecombat_jax.files.atomic import write_atomic
from dronecombat_jax.types import SIDES, Cause, Outcome

FORMAT = 2  # 1: entrants have no `also`
RESULT_NAME = "result.npz"
ABOUT_NAME = "result.json"


def save_result(folder: Path, result: TournamentResult, about: dict[str, Any]) -> None:
    """Write both files into `folder`; equal results give equal bytes. `about`: plain JSON beside
    the entrants.
    """
    header = {
        "format": FORMAT,
        **about,
        "control_dt": result.control_dt,
        "winner": {
            cause.name.lower(): Outcome(result.winner[cause]).name.lower()
            for cause in Cause
            if cause
        },
        **{
            f"{role}s": [_fields(entrant) for entrant in side]
            for role, side in zip(SIDES, _sides(result), strict=True)
        },
    }
    text = json.dumps(header, indent=1, allow_nan=False) + "\n"
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        counts=result.counts,
        cause=result.cause,
        steps=result.steps,
        played=result.played,
        winner=np.asarray(result.winner, np.int8),
        control_dt=np.float64(result.control_dt),
        about=np.frombuffer(text.encode(), np.uint8),
    )
    write_atomic(folder / RESULT_NAME, buffer.getvalue())
    write_atomic(folder / ABOUT_NAME, text)


def load_result(path: Path | str) -> TournamentResult:
    """The result in a tournament's folder, or in a result file.

    UserError 3 where it is missing or damaged.
    """
    return _read(path)[0]


def load_about(path: Path | str) -> dict[str, Any]:
    """What `result.json` says, read from the result file itself. UserError 3."""
    return _read(path)[1]


def find_tournament(word: str, root: str = "tournaments") -> Path:
    """A tournament's folder or result file: given by its path, or by its name in `root`. UserError
    2 and 3.
    """
    if not word:
        raise UserError(
            f"TOURNAMENT is missing: a folder, a result file, or a name in {root}/", EXIT_CONFIG
        )
    for path in (Path(word), Path(root, word)):
        if path.exists():
            return path
    names = sorted(path.name for path in Path(root).iterdir()) if Path(root).is_dir() else []
    raise UserError(f"{one_line(word)}: no such tournament; {suggestion(word, names)}", EXIT_DATA)


def _read(path: Path | str) -> tuple[TournamentResult, dict[str, Any]]:
    path = Path(path)
    file = path / RESULT_NAME if path.is_dir() else path
    name = one_line(str(file))
    try:
        with np.load(file, allow_pickle=False) as stored:
            about = json.loads(stored["about"].tobytes())
            if about["format"] > FORMAT:
                raise UserError(
                    f"{name} has format {about['format']}: upgrade dronecombat-jax", EXIT_DATA
                )
            winner = [Outcome(int(outcome)) for outcome in stored["winner"]]
            defenders, attackers = (
                [_entrant(fields) for fields in about[f"{role}s"]] for role in SIDES
            )
            arrays = {part: stored[part] for part in ("cause", "steps", "played", "counts")}
            control_dt = float(stored["control_dt"])
    except FileNotFoundError:
        raise UserError(f"{name}: no result of a tournament; is it complete?", EXIT_DATA) from None
    except OSError as error:
        raise UserError(f"{name}: cannot be read: {error.strerror or error}", EXIT_DATA) from None
    except (
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        EOFError,
        zipfile.BadZipFile,
        RecursionError,
    ) as error:
        raise UserError(
            f"{name}: damaged or no result: {one_line(str(error))}", EXIT_DATA
        ) from None
    result = tournament_result(
        arrays["cause"], arrays["steps"], winner, defenders, attackers, control_dt, arrays["played"]
    )
    if not np.array_equal(result.counts[..., : len(winner)], arrays["counts"][..., : len(winner)]):
        raise UserError(f"{name}: damaged: its counts are not those of its fights", EXIT_DATA)
    return result, about


def _fields(entrant: Entrant) -> dict[str, Any]:
    return {**entrant._asdict(), "also": [name._asdict() for name in entrant.also]}


def _entrant(fields: dict[str, Any]) -> Entrant:
    return Entrant(**{**fields, "also": tuple(Alias(**name) for name in fields.get("also", ()))})


def _sides(result: TournamentResult) -> tuple[tuple[Entrant, ...], tuple[Entrant, ...]]:
    return result.defenders, result.attackers
