"""Starts by name, for evaluations, replays and tournaments."""

import pytest

from dronecombat_jax.config import settings
from dronecombat_jax.config.starts import EVEN_SETBACK, with_starts


@pytest.mark.parametrize(
    ("starts", "expected"),
    [
        ("", ("fixed", 1.0, 0.5)),
        ("as_trained", ("fixed", 1.0, 0.5)),
        ("fixed", ("fixed", 0.0, 0.0)),
        ("uniform", ("uniform", 0.0, 0.0)),
        ("even", ("fixed", 1.0, EVEN_SETBACK)),
    ],
)
def test_other_starts(starts: str, expected: tuple[str, float, float]):
    trained = settings.load("duel", {"game.defender_setback": 0.5})
    game = with_starts(trained, starts).game
    assert (game.spawn, game.spawn_spread, game.defender_setback) == expected
