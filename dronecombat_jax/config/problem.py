"""A rule across settings that is broken."""

from typing import NamedTuple


class Problem(NamedTuple):
    """The settings involved, the likeliest culprit first, and the rule."""

    keys: tuple[str, ...]
    message: str
