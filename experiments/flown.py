"""A tournament of trained runs for a study's tables; it goes on where it stopped."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dronecombat_jax.analysis.result import TournamentResult
from dronecombat_jax.errors import EXIT_TOURNAMENT, UserError


def flown(words: Sequence[str], folder: Path, fights: int, **options: Any) -> TournamentResult:
    """The result of everybody whom `words` name, `fights` of each pair, kept in `folder`; `options`
    of `tournaments.tournament.tournament`. SystemExit, one line, for what cannot be flown.
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
