"""What a page says by `<!-- made: WHAT -->` is put there when the site is built.

WHAT is `settings`, `commands`, or `notebook NAME`: made from the schema, the flags and the percent
scripts, so that no page can fall behind them. `docs/NAME.md` in a text becomes a link.
"""

import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = ROOT / "experiments" / "notebooks"
MARK = re.compile(r"<!-- made: (?P<what>settings|commands|notebook (?P<name>\w+)) -->")
# `docs/faults.md` or docs/faults.md in prose, where it is no link yet
MENTION = re.compile(r"(?<![\w(/`])(?P<tick>`?)docs/(?P<page>\w+)\.md(?P=tick)(?![\w)`])")

SETUP = """```python
import dronecombat_jax as dc  # the notebook's first cell also installs it, and chooses SIZES
```"""


def setup(app: Any) -> dict[str, bool]:
    """Replace the marks while Sphinx reads a page."""
    app.connect("source-read", _fill)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def filled(text: str) -> str:
    """The page with its marks replaced."""
    return MARK.sub(lambda mark: _made(mark["what"], mark["name"]), text)


def settings_tables() -> str:
    """A heading and a table for each section of settings."""
    from dronecombat_jax.config.fields import Config
    from dronecombat_jax.config.schema import written
    from dronecombat_jax.config.settings import SCHEMA, flag

    blocks = []
    for section in fields(Config):
        about = (section.default_factory.__doc__ or "").splitlines()[0]  # pyright: ignore
        rows = ["| setting | default | allowed | what it is |", "|---|---|---|---|"]
        for key, entry in SCHEMA.items():
            if key.startswith(section.name + "."):
                cells = (f"`{flag(key)}`", f"`{written(entry.default)}`", entry.allowed, entry.doc)
                rows.append("| " + " | ".join(_cell(cell) for cell in cells) + " |")
        blocks.append("\n".join([f"## {section.name}", "", about, "", *rows]))
    return "\n\n".join(blocks)


def commands() -> str:
    """A heading for each command, and what its --help says."""
    from dronecombat_jax.cli.commands import COMMANDS

    blocks = []
    for name, command in COMMANDS.items():
        about = (command.__doc__ or "").splitlines()[0]
        text = _help(name)
        after = ""
        if name == "train":  # its settings have a page of their own
            text, after = text.partition("\nsim:")[0], "\n\nAnd [every setting](settings.md)."
        blocks.append(f"## {name}\n\n{about}\n\n```text\n{text.strip()}\n```{after}")
    return "\n\n".join(blocks)


def notebook(name: str) -> str:
    """A notebook as Markdown: its texts and its code, without outputs."""
    import jupytext

    cells = jupytext.reads((NOTEBOOKS / f"{name}.py").read_text(), fmt="py:percent").cells
    return "\n\n".join(_cells(cells))


def _cells(cells: list[Any]) -> Iterator[str]:
    for cell in cells:
        tags = cell.metadata.get("tags", ())
        if "badge" in tags:
            continue
        if "setup" in tags:
            yield SETUP
        elif cell.cell_type == "markdown":
            yield re.sub(r"\]\((\w+)\.ipynb\)", r"](\1.md)", cell.source)
        else:
            yield f"```python\n{cell.source}\n```"


def _made(what: str, name: str | None) -> str:
    if name:
        return notebook(name)
    return {"settings": settings_tables, "commands": commands}[what]()


def _help(command: str) -> str:
    """What `dronecombat COMMAND --help` prints, as wide as a page."""
    import contextlib
    import io
    import os

    from dronecombat_jax.cli import commands as program

    printed = io.StringIO()
    os.environ["COLUMNS"] = "84"
    with contextlib.redirect_stdout(printed):
        assert program.main([command, "--help"]) == 0
    return printed.getvalue()


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _fill(app: Any, page: str, source: list[str]) -> None:
    to_top = "../" * page.count("/")
    lines = filled(source[0]).split("\n")
    link = lambda match: (
        f"[{match['tick']}docs/{match['page']}.md{match['tick']}]({to_top}{match['page']}.md)"
    )
    source[0] = "\n".join(
        line if line.startswith(("    ", "```", "#")) else MENTION.sub(link, line) for line in lines
    )
