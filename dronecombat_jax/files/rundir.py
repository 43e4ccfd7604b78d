"""The directory of one run, `runs/<name>/`: its paths and where to find it.

What does not live here: who may write there (`claim`), the content of the files (`checkpoint`,
`metrics`, `dronecombat_jax.report`).
"""

import difflib
import os
import re
from dataclasses import dataclass
from pathlib import Path

from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA, UserError

_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}")


@dataclass(frozen=True)
class RunDirectory:
    """Paths of one run; making the object touches nothing."""

    path: Path
    inode: tuple[int, int] | None = None  # device and inode when it was claimed; None: only read

    @property
    def name(self) -> str:
        return self.path.name

    @property
    def config(self) -> Path:
        return self.path / "config.toml"

    @property
    def metrics(self) -> Path:
        return self.path / "metrics.jsonl"

    @property
    def chunks(self) -> Path:
        return self.path / "chunks.jsonl"

    @property
    def tensorboard(self) -> Path:
        return self.path / "tensorboard"

    @property
    def checkpoints(self) -> Path:
        return self.path / "checkpoints"

    @property
    def opponents(self) -> Path:
        return self.path / "opponents"

    @property
    def figures(self) -> Path:
        return self.path / "figures"

    @property
    def video(self) -> Path:
        return self.path / "fight.mp4"

    @property
    def replay(self) -> Path:
        return self.path / "replay.html"

    @property
    def evaluation(self) -> Path:
        return self.path / "evaluation.json"


def check_name(name: str) -> str:
    """The name itself, if it can be a directory everywhere; else UserError 2."""
    if not _NAME.fullmatch(name):
        raise UserError(
            f"run name {name[:120]!r} is not allowed: 1 to 100 of the characters A-Z a-z 0-9 . _ -, "
            "the first not a dot",
            EXIT_CONFIG,
        )
    return name


def run_path(root: Path | str, name: str) -> Path:
    """`root/name`. UserError 2 for a bad name, or where a link leads out of `root`."""
    path = Path(root) / check_name(name)
    if path.resolve().parent != Path(root).resolve():
        raise UserError(
            f"run {path} is a link that leads out of {root}: {path.resolve()}", EXIT_CONFIG
        )
    return path


def find_run(word: str, root: Path | str = "runs") -> Path:
    """The folder of an existing run, for reading: given by its path, or by its name in `root`.

    Raises UserError 3 that names the closest run, or those that there are; 2 where `word` is empty.
    """
    home = Path(root)
    if not word:
        raise UserError(f"RUN is missing: a folder, or a name in {home}/", EXIT_CONFIG)
    for folder in (Path(word), home / word):
        if os.path.isdir(folder):  # False, where Path raises on a name too long
            return folder
    names = sorted(path.name for path in home.iterdir() if path.is_dir()) if home.is_dir() else []
    close = difflib.get_close_matches(word, names, n=1)
    hint = (
        f"did you mean {close[0]}?"
        if close
        else f"runs there are: {', '.join(names[:10]) or 'none'}"
    )
    raise UserError(f"{word}: no such run; {hint}", EXIT_DATA)
