"""The words of a command line that belong to no flag, such as runs and policy files."""

from collections.abc import Sequence

from dronecombat_jax.config import settings
from dronecombat_jax.config.schema import settings_of


def split_words(args: Sequence[str], cls: type) -> tuple[list[str], list[str]]:
    """The words that belong to no flag of `cls`, in order, and everything else."""
    with_value = {
        settings.flag(key) for key, entry in settings_of(cls).items() if entry.kind != "bool"
    }
    words: list[str] = []
    rest: list[str] = []
    for word in args:
        value = bool(rest) and rest[-1].replace("_", "-") in with_value
        (rest if value or word.startswith("-") else words).append(word)
    return words, rest
