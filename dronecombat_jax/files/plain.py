"""Tables of plain values and how they are written: CSV that no spreadsheet executes, JSON that
every reader takes.
"""

import csv
import io
import json
import math
from typing import Any, NamedTuple

import numpy as np

FORMULA = ("=", "+", "-", "@")  # what a spreadsheet would execute at the start of a cell
Value = str | int | float | bool | None


class Table(NamedTuple):
    """A table with its unit and gauge in words."""

    name: str  # of its files
    about: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Value, ...], ...]


def to_csv(table: Table) -> str:
    """RFC 4180; empty where a number is not known, inf and -inf where an interval has no end."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(table.columns)
    writer.writerows([_csv_cell(value) for value in row] for row in table.rows)
    return out.getvalue()


def to_json(value: Any) -> str:
    """Plain JSON; null where a number is not known or an interval has no end."""
    return json.dumps(_plain(value), indent=1, allow_nan=False) + "\n"


def records(table: Table) -> dict[str, Any]:
    """The table for JSON: what it is, and one object a row."""
    return {
        "about": table.about,
        "rows": [dict(zip(table.columns, row, strict=True)) for row in table.rows],
    }


def one_line(text: str) -> str:
    """Foreign text whole, on one line."""
    return "".join(c if c.isprintable() else "?" for c in text)


def plain_value(value: Any) -> Value:
    """A NumPy scalar as Python's; any other value as it is."""
    return value.item() if isinstance(value, np.generic) else value


def _csv_cell(value: Value) -> Value:
    if isinstance(value, str):
        text = one_line(value)
        return "'" + text if text.startswith(FORMULA) else text
    return "" if value is None or (isinstance(value, float) and math.isnan(value)) else value


def _plain(value: Any) -> Any:
    value = plain_value(value)
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
