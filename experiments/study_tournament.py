"""A tournament of a study's trained runs, for its tables; and the flags of the commands that fly one."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.analysis.result import TournamentResult, first_episodes
from dronecombat_jax.analysis.study import ELO_EPISODES, Effort, own_elo
from dronecombat_jax.errors import EXIT_TOURNAMENT, UserError


def flown(words: Sequence[str], folder: Path, fights: int, **options: Any) -> TournamentResult:
    """The result of everybody whom `words` name, `fights` of each pair, kept in `folder`, where it
    goes on if it was stopped; `options` of `tournaments.tournament.tournament`. SystemExit, one line,
    for what cannot be flown.
    """
    from dronecombat_jax.arena.rectangle import Rules
    from dronecombat_jax.machine import backend
    from dronecombat_jax.tournaments.result_file import load_result
    from dronecombat_jax.tournaments.tournament import tournament

    backend.prepare("cpu")
    try:
        code = tournament(
            words, Rules(fights), name=folder.name, root=str(folder.parent), **options
        )
        if code not in (0, EXIT_TOURNAMENT):
            raise SystemExit(code)
        return load_result(folder)
    except UserError as error:
        raise SystemExit(str(error)) from None


def own_ratings(result: TournamentResult) -> dict[str, NDArray[np.float64]]:
    """Elo within each run's own tournament, by lineage, from as many fights of a pair as the paper takes."""
    rated = first_episodes(result, min(ELO_EPISODES, result.cause.shape[2]))
    return own_elo(rated, Effort().orders)


def study_flags(about: str | None, fights: int) -> argparse.ArgumentParser:
    """The flags that all such commands have; `about`: the module's words, `fights`: of a pair."""
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("study", type=Path, help="a study file")
    parser.add_argument(
        "--runs", type=Path, default=Path("runs"), help="folder that holds all studies"
    )
    parser.add_argument("--tournaments", type=Path, default=Path("tournaments"))
    parser.add_argument("--fights", type=int, default=fights, help="of a pair (%(default)s)")
    parser.add_argument("--table", action="store_true", help="fly nothing, print what is kept")
    return parser
