"""Which name was meant by a word that is none."""

import difflib
from collections.abc import Iterable


def suggestion(word: str, known: Iterable[str]) -> str:
    """The known name that was meant by `word`, or the names that there are."""
    names = list(known)
    plain = word.replace("-", "_").lower()
    same_leaf = [name for name in names if name.split(".")[-1] == plain.split(".")[-1]]
    close = (
        same_leaf
        or difflib.get_close_matches(plain, names, n=1, cutoff=0.6)
        or _close_leaf(plain, names)
    )
    if close:
        return f"did you mean {close[0]}?"
    inside = [name for name in names if name.startswith(plain.split(".")[0] + ".")]
    sections = list(dict.fromkeys(name.split(".")[0] for name in names))
    return "there are: " + ", ".join(inside or sections)


def _close_leaf(word: str, names: list[str]) -> list[str]:
    """The closest by last part alone: a right name in a wrong or missing section."""
    leaves = {name.split(".")[-1]: name for name in names}
    return [
        leaves[leaf]
        for leaf in difflib.get_close_matches(word.split(".")[-1], leaves, n=1, cutoff=0.75)
    ]
