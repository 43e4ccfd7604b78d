"""The page on which a person flies against a policy: one file that opens anywhere.

The script is built from `viewer/` at the repository's root. What does not live here: its data
(`play_data`), who flies (`watch.play`).
"""

import functools
from pathlib import Path
from typing import Any

from dronecombat_jax.report.replay_page import document, plain

SCRIPT = Path(__file__).with_name("viewer") / "play.js"
_WAITING = (
    "The game stands here once its script has run. "
    "If this sentence stays, this place runs no scripts: open the page in a browser."
)


def page(data: dict[str, Any]) -> str:
    """One self-contained file. It loads nothing from a network, and its content security policy
    forbids it.
    """
    code = f'{script()}\ndronecombatPlay("play", {plain(data)});'
    return document("play", data["title"], _WAITING, code)


@functools.cache
def script() -> str:
    """The built script."""
    return SCRIPT.read_text(encoding="utf-8")
