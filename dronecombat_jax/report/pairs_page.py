"""A tournament's pairs as the plain data of a page: the win-rate maps, and a fight for each cell.

What does not live here: flying the fights (`watch.pairs`), the page (`replay_page.pairs_page`).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.config.schema import one_line
from dronecombat_jax.report.map_panels import Panel
from dronecombat_jax.report.replay_data import Fight, fight_data
from dronecombat_jax.report.shown_rules import Rules, rules_data

MOST_STATES = 100_000  # of all fights of a page: 7.5 MB; longer fights keep every n-th state


class PairsMap(NamedTuple):
    """One map of the page."""

    panel: Panel
    about: str  # whose fights these are
    labels: tuple[Sequence[str], Sequence[str]]  # of defenders and attackers
    fights: NDArray[np.integer]  # [R, C] numbers of the fights, -1: none


def pairs_data(
    title: str, about: str, maps: Sequence[PairsMap], fights: Sequence[Fight], rules: Rules
) -> dict[str, Any]:
    """All that the page shows, as plain JSON."""
    most = max(2, MOST_STATES // max(len(fights), 1))
    return {
        "title": title,
        "about": about,
        "rules": rules_data(rules),
        "maps": [_map(shown) for shown in maps],
        "fights": [fight_data(fight, rules, most) for fight in fights],
    }


def _map(shown: PairsMap) -> dict[str, Any]:
    rates = np.round(shown.panel.values, 4)
    return {
        "name": one_line(shown.panel.method),
        "about": one_line(shown.about),
        "rows": [one_line(label) for label in shown.labels[0]],
        "columns": [one_line(label) for label in shown.labels[1]],
        "rates": _or_none(rates, np.isfinite(rates)),
        "fights": _or_none(shown.fights, shown.fights >= 0),
    }


def _or_none(values: NDArray[Any], known: NDArray[np.bool_]) -> list[list[Any]]:
    """The rows of a table as JSON has them: None where nothing is known."""
    table = values.astype(object)
    table[~known] = None
    return table.tolist()
