"""One setting: a dataclass field with its unit, its bounds and one line of explanation."""

from dataclasses import field
from typing import Any


def setting(
    default: Any,
    doc: str,
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    low_open: bool = False,
    own: bool = False,
    file: str = "",
) -> Any:
    """A dataclass field with the metadata that validation, `--help` and the docs read.

    `low` and `high` are inclusive bounds (`low_open`: `low` itself is excluded).
    `own`: besides the choices, MODULE:NAME of the user's own (`own`). `file`: besides them, a file
    with this suffix.
    """
    return field(
        default=default,
        metadata={
            "doc": doc,
            "unit": unit,
            "low": low,
            "high": high,
            "low_open": low_open,
            "own": own,
            "file": file,
        },
    )
