"""What trainings of a study have come to, kept beside the study file: studies/NAME.jsonl.

A line a run: its variant and seed, the settings that are not the package's defaults, who trained it
(commit, processor), and its measures (`measured.of`). So a study goes on where it was, on another
machine, too. A line counts while the variant has the same settings and as many steps.
"""

import json
import platform
import subprocess
from pathlib import Path
from typing import Any

from dronecombat_jax.files.atomic import write_atomic

NOT_OF_THE_GAME = ("run.", "train.seed", "train.num_seeds")


def settings_of(preset: str, settings: dict[str, Any], steps: int) -> dict[str, Any]:
    """The settings of a variant that are not the package's defaults, by dotted key."""
    from dronecombat_jax.config import settings as read
    from dronecombat_jax.config.fields import Config

    config = read.load(preset, {**settings, "train.total_steps": steps})
    changed = {key: value for key, _, value in read.diff(Config(), config)}
    return json.loads(
        json.dumps({k: v for k, v in changed.items() if not k.startswith(NOT_OF_THE_GAME)})
    )


def read_lines(path: Path) -> list[dict[str, Any]]:
    """A file of JSON lines; none where it is not there. SystemExit, one line, for one that cannot
    be read.
    """
    try:
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        return [json.loads(line) for line in text.splitlines()]
    except (OSError, ValueError) as error:
        raise SystemExit(f"{path}: {error}") from None


class Kept:
    """The lines of one study; `kind`: of another measure than `measured.of`, kept in a file of its own,
    studies/NAME_KIND.jsonl. SystemExit, one line, for a file that cannot be read.
    """

    def __init__(self, study: Path, kind: str = ""):
        self.path = study.with_name(f"{study.stem}{kind and '_'}{kind}.jsonl")
        self._lines = self._read()

    def _read(self) -> list[dict[str, Any]]:
        return read_lines(self.path)

    def find(self, variant: str, seed: int, settings: dict[str, Any]) -> dict[str, Any] | None:
        """The measures of a run; None where none is kept, or of other settings."""
        for line in self._lines:
            if (line["variant"], line["seed"], line["settings"]) == (variant, seed, settings):
                return line["measured"]
        return None

    def keep(
        self, variant: str, seed: int, settings: dict[str, Any], numbers: dict[str, Any]
    ) -> None:
        """Enter a run; one of the same variant and seed gives way to it. What another process has
        entered meanwhile stays.
        """
        of = lambda line: (line["variant"], line["seed"])
        new = {
            "variant": variant,
            "seed": seed,
            "settings": settings,
            **_maker(),
            "measured": numbers,
        }
        others = (line for line in self._read() if of(line) != of(new))
        self._lines = sorted([*others, new], key=of)
        write_atomic(self.path, "".join(json.dumps(line) + "\n" for line in self._lines))


def _maker() -> dict[str, str]:
    """Who trained: the commit, and the processor's kind."""
    words = ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short=12", "HEAD"]
    said = subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()
    return {"commit": said, "machine": f"{platform.machine()}, Python {platform.python_version()}"}
