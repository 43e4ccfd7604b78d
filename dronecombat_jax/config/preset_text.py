"""The text of a preset file: read it, name the line of a key and of a mistake.

What does not live here: what the keys mean (`settings`).
"""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

from dronecombat_jax.config.schema import one_line
from dronecombat_jax.errors import UserError

MAX_FILE_BYTES = 1_000_000
_HEADER = re.compile(r"""\s*\[\s*["']?([A-Za-z0-9_-]+)["']?\s*\]""")
_ENTRY = re.compile(r"""\s*["']?([A-Za-z0-9_.-]+)["']?\s*=""")
_AT_LINE = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)$")


def text_of(path: Path) -> str:
    """The text of the small UTF-8 file at `path`; UserError for anything else."""
    try:
        if not path.is_file():
            raise UserError(f"{path}: {'not a file' if path.exists() else 'no such file'}")
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except (OSError, ValueError) as error:
        raise UserError(
            f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}"
        ) from None
    if len(data) > MAX_FILE_BYTES:
        raise UserError(f"{path}: larger than {MAX_FILE_BYTES} bytes; that is no preset")
    if data.startswith((b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff")):
        raise UserError(f"{path}:1: starts with a byte-order mark; save it as UTF-8 without BOM")
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise UserError(f"{path}:{line}: not UTF-8 (byte 0x{data[error.start]:02x})") from None


def syntax_error(path: str, error: BaseException) -> str:
    """One line for a parser's error, with the line number that Python hides in its text."""
    if isinstance(error, RecursionError):
        return f"{path}: not valid TOML: nested too deeply"
    if not isinstance(error, tomllib.TOMLDecodeError):
        return f"{path}: not valid TOML: a number has too many digits"
    text = str(error)
    place = _AT_LINE.search(text)
    reason = text[: place.start()] if place else text
    reason = {"Cannot overwrite a value": "the same key twice"}.get(reason, reason)
    line = f":{place[1]}" if place and place[1] else ""
    return f"{path}{line}: not valid TOML: {one_line(reason)}"


def lines_of(text: str) -> dict[str, int]:
    """The line of each dotted key and section; nothing where a multi-line string could mislead."""
    if '"""' in text or "'''" in text:
        return {}
    return dict(reversed(list(_entries(text))))


def _entries(text: str) -> Iterator[tuple[str, int]]:
    section = ""
    for number, line in enumerate(text.split("\n"), start=1):
        if header := _HEADER.match(line):
            section = header[1] + "."
            yield header[1], number
        elif entry := _ENTRY.match(line):
            yield section + entry[1], number
