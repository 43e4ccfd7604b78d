"""The pilots of the package that an exploited policy also meets: who they are, and who is best."""

from collections.abc import Callable

import jax
from toy import Coasting

from dronecombat_jax.combat.scripted import PILOTS
from dronecombat_jax.config import settings
from dronecombat_jax.policies import shipped
from dronecombat_jax.runs.exploit import best_known
from dronecombat_jax.runs.known_pilots import Known, known_pilots
from dronecombat_jax.types import ATTACKER, DEFENDER

KEYS = list(jax.random.split(jax.random.key(3), 3))


def winning(*counts: tuple[int, int]) -> Callable[..., tuple[int, int]]:
    """Wins and ties in the fights of each of `KEYS`."""
    table = {str(jax.random.key_data(key)): pair for key, pair in zip(KEYS, counts, strict=True)}
    return lambda _, key: table[str(jax.random.key_data(key))]


def test_all_shipped_pilots_of_the_side_and_the_plain_scripted_ones():
    made = []
    combat = Coasting(settings.load("responder"))
    those = known_pilots(combat, DEFENDER, lambda pilot: made.append(pilot) or (lambda *_: (0, 0)))
    wanted = [name for name in shipped.names() if "-defender-" in name]
    assert [one.name for one in those] == [*wanted, *PILOTS[DEFENDER]]
    assert len(made) == 2 + len(
        PILOTS[DEFENDER]
    )  # those that see `world`, and those that see `tracks`


def test_who_was_trained_in_another_game_is_left_out():
    combat = Coasting(settings.load("duel", {"game.intercept_radius": 0.4}))
    those = known_pilots(combat, ATTACKER, lambda _: lambda *_: (0, 0))
    assert [one.name for one in those] == list(PILOTS[ATTACKER])


def test_the_best_is_chosen_by_its_own_fights_and_counted_in_others():
    those = [
        Known("lucky", winning((8, 0), (1, 1), (2, 0)), ()),
        Known("as lucky", winning((8, 0), (9, 0), (9, 0)), ()),
        Known("good", winning((7, 3), (9, 0), (9, 0)), ()),
    ]
    best = best_known(those, KEYS[0], KEYS[1:], batch=10)
    assert (best["name"], best["won"][0], best["drawn"]) == ("lucky", 3 / 20, 1 / 20)
    assert best["chosen_by"] == {"lucky": 0.8, "as lucky": 0.8, "good": 0.7}
