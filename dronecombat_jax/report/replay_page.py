"""A replay as HTML: one file that opens anywhere, or one notebook cell. Data in, text out.

The script is built from `viewer/` at the repository's root. What does not live here: the data
(`replay_data`), files (`replay`).
"""

import functools
import json
import re
from html import escape
from pathlib import Path
from typing import Any

SCRIPT = Path(__file__).with_name("viewer") / "replay.js"
CELL_HEIGHT = 620  # pixels
_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"
_STYLE = """
html, body {{ height: 100%; margin: 0 }} :root {{ color-scheme: light dark }}
body {{ font: 16px/1.5 system-ui, sans-serif }}
#{name}, .dronecombat-{name}-page {{ height: 100vh; height: 100dvh }}
#{name} > p {{ margin: 0; padding: 2rem }}
"""
_WAITING = (
    "The replay of the fights stands here once its script has run. "
    "If this sentence stays, this place runs no scripts: open the page in a browser."
)


def page(data: dict[str, Any]) -> str:
    """One self-contained file. It loads nothing from a network, and its content security policy
    forbids it.
    """
    code = f"{script()}\n{_call('replay', data, embedded=False)}"
    return document("replay", data["title"], _WAITING, code)


def pairs_page(data: dict[str, Any]) -> str:
    """The same for a tournament's pairs (`pairs_data`): a map, and the fight of the cell clicked."""
    code = f"{script()}\ndronecombatPairs({plain('replay')}, {plain(data)});"
    return document("replay", data["title"], _WAITING, code)


def document(name: str, title: str, waiting: str, code: str) -> str:
    """A whole page: an element `name` that holds `waiting` until the script `code` fills it."""
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1, viewport-fit=cover">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        f'<link rel="icon" href="data:,">\n<title>{escape(title)}</title>\n'
        f"<style>{_STYLE.format(name=name)}</style>\n"
        f'</head>\n<body>\n<div id="{name}"><p>{waiting}</p></div>\n'
        f"<script>{code}</script>\n</body>\n</html>\n"
    )


def cell(data: dict[str, Any], name: str, height: int = CELL_HEIGHT) -> str:
    """A `div` and a classic script for a notebook's output; `name`: the div's id, another for each.

    No frame, since VS Code runs no scripts in nested ones. The whole script is in each cell and
    runs in the first: a notebook that was exported, or whose other cells were cleared, still plays.
    """
    once = f"if (globalThis.dronecombatReplay?.sources !== {plain(sources())}) {{\n{script()}\n}}"
    return (
        f'<div id="{escape(name)}" data-lm-suppress-shortcuts="true" '
        f'style="height: {int(height)}px">'
        f"<p>{_WAITING}</p></div>\n<script>{once}\n{_call(name, data, embedded=True)}</script>\n"
    )


@functools.cache
def script() -> str:
    """The built script."""
    return SCRIPT.read_text(encoding="utf-8")


def sources() -> str:
    """sha256 in hex of the sources that the script says it was built from."""
    line = re.search(r"^sources sha256 ([0-9a-f]{64})$", script()[:1000], re.MULTILINE)
    assert line, f"{SCRIPT}: not built by viewer/build.mjs"
    return line[1]


def _call(name: str, data: dict[str, Any], embedded: bool) -> str:
    options = json.dumps({"embedded": embedded})
    return f"dronecombatReplay({plain(name)}, {plain(data)}, {options});"


def plain(value: Any) -> str:
    """JSON inside a script: no name can end the script or begin a comment in it."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
