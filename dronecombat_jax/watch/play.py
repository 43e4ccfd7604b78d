"""`dronecombat play`: the page on which a person flies against a policy.

What does not live here: who is named (`flyers`), the page (`report.play_page`), its data
(`report.play_data`).
"""

from pathlib import Path

from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.sides import require_duel
from dronecombat_jax.errors import UserError
from dronecombat_jax.report.play_data import (
    Data,
    Opponent,
    game_data,
    opponent_data,
    refuse_unknown_game,
)
from dronecombat_jax.report.play_page import page
from dronecombat_jax.sim.scene import load_scene
from dronecombat_jax.types import ATTACKER, DEFENDER, SIDES
from dronecombat_jax.watch.flyers import Opponents, read_opponents
from dronecombat_jax.watch.replay import PAGE_SUFFIX, open_page, save_page


def play(
    words: tuple[str, ...],
    *,
    side: str = "",
    run_seed: int = -1,
    out: Path | None = None,
    browser: bool = False,
) -> int:
    """Write the page and name it; returns 0. UserError: 2 for words, 3 for data, 73 for files."""
    opponents = read_opponents(words, run_seed)
    path = out or (opponents.run.path / "play.html" if opponents.run else Path("play.html"))
    if path.suffix != PAGE_SUFFIX:
        raise UserError(f"{one_line(str(path))}: the page ends in {PAGE_SUFFIX}")
    data = play_data(opponents, side)
    save_page(path, page(data))
    size = path.stat().st_size / 1e6
    print(f"{data['title']}: {path} ({size:.2f} MB, opens in any browser)", flush=True)
    if browser:
        open_page(path)
    return 0


def play_data(opponents: Opponents, side: str = "") -> Data:
    """All that the page shows and flies, as plain JSON; `side`: what a person flies first.

    UserError 2 for a game that the page cannot fly, or a side that has no opponent.
    """
    config = opponents.config
    require_duel(config.game.sides, "the page to fly in")
    refuse_unknown_game(config)
    person = _person(opponents, side)
    opponent = opponents.flyers[1 - person]
    assert opponent is not None
    return {
        "title": f"Fly against {one_line(opponent.label)}",
        "side": person,
        "opponents": [
            flyer
            and opponent_data(Opponent(flyer.label, flyer.pilot, flyer.learn, flyer.observation))
            for flyer in opponents.flyers
        ],
        "game": game_data(config, load_scene(config.sim)),
    }


def _person(opponents: Opponents, side: str) -> int:
    """The role that a person flies first: `side`, or the attacker where somebody defends."""
    if not side:
        return ATTACKER if opponents.flyers[DEFENDER] else DEFENDER
    person = SIDES.index(side)
    if opponents.flyers[1 - person] is None:
        here = opponents.flyers[person]
        label = here.label if here else "the opponent"
        raise UserError(
            f"--side {side}: {label} flies the {side}; fly the {SIDES[1 - person]} against it"
        )
    return person
