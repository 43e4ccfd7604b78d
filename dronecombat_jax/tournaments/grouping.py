"""Which runs are of one kind: grouped by method, by preset or by any setting, to be compared."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from dronecombat_jax.analysis.panel import EVERY
from dronecombat_jax.analysis.result import TournamentResult, showings
from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.opponents import method
from dronecombat_jax.config.schema import flatten, one_line, written
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.files.rundir import RunDirectory

WAYS = ("method", "preset", "run")
# what may differ within one kind
NOT_THE_KIND = ("run.", "train.seed", "train.num_seeds", "train.total_steps")


def read_configs(paths: Sequence[Path]) -> dict[str, Config]:
    """The configuration of each run by its name.

    UserError for two of one name, or what cannot be read.
    """
    configs: dict[str, Config] = {}
    for path in paths:
        run = RunDirectory(path)
        try:
            text = run.config.read_text()
        except (OSError, UnicodeDecodeError) as error:
            raise UserError(
                f"{run.config}: cannot be read: {getattr(error, 'strerror', None) or error}",
                EXIT_DATA,
            ) from None
        if run.name in configs:
            raise UserError(f"two runs are called {run.name}; a comparison needs a name for each")
        configs[run.name] = settings.from_toml(text, str(run.config))
    return configs


def group(configs: Mapping[str, Config], by: str) -> dict[str, str]:
    """The kind of each run, by its name: `by` "method", "preset", "run", or a dotted setting.
    UserError otherwise.
    """
    if by not in WAYS and by not in settings.SCHEMA:
        raise UserError(
            f"--by {one_line(by)}: {settings.suggestion(by, [*WAYS, *settings.SCHEMA])}"
        )
    return {run: _kind(run, config, by) for run, config in configs.items()}


def other_differences(configs: Mapping[str, Config], by: str) -> list[str]:
    """Settings besides `by` and the seeds in which the runs differ: whatever is found may be due to
    them.
    """
    values = [flatten(config) for config in configs.values()]
    expected = ("run.", "train.seed", "train.num_seeds", "selfplay." if by == "method" else by)
    asked = ["train.total_steps"] if by in ("preset", "run") else list(settings.SCHEMA)
    differ = lambda key: any(value[key] != values[0][key] for value in values)
    return [key for key in asked if not key.startswith(expected) and differ(key)]


class Compared(NamedTuple):
    """How a tournament's runs were, or are to be, compared."""

    by: str = "method"
    every: int = EVERY  # chunks between a run's attackers on the panel


def as_compared(
    result: TournamentResult, about: Mapping[str, Any]
) -> tuple[TournamentResult, Compared]:
    """The tournament with the kinds and the panel that its `about` has from the `compare` that flew
    it.
    """
    if "methods" not in about:
        return result, Compared()
    return regroup(result, about["methods"]), Compared(str(about["by"]), int(about["panel_every"]))


def regroup(result: TournamentResult, groups: Mapping[str, str]) -> TournamentResult:
    """The same tournament with each entrant's method named by `groups`, run by run; pilots stay
    what they are.
    """
    # of several seeds each is "run/seed"
    kind = lambda run: groups.get(run) or groups.get(run.rpartition("/")[0])
    for _, entrant in showings([*result.defenders, *result.attackers]):
        if entrant.run and not kind(entrant.run):
            raise UserError(
                f"the tournament has a run that was not given: {entrant.run}", EXIT_DATA
            )
    named = lambda entrant: entrant._replace(method=kind(entrant.run)) if entrant.run else entrant
    rename = lambda side: tuple(
        named(entrant)._replace(also=tuple(map(named, entrant.also))) for entrant in side
    )
    return result._replace(defenders=rename(result.defenders), attackers=rename(result.attackers))


def _kind(run: str, config: Config, by: str) -> str:
    if by == "run":
        return run
    if by == "method":
        return method(config)
    if by == "preset":
        return _preset(config)
    return f"{by} = {one_line(written(flatten(config)[by]))}"


def _preset(config: Config) -> str:
    """The preset that differs least from the run, and in what it differs."""
    best: tuple[str, list[str]] | None = None
    for name in settings.presets():
        changed = [
            f"{key} {written(value)}"
            for key, _, value in settings.diff(settings.load(name, {}), config)
            if not key.startswith(NOT_THE_KIND)
        ]
        if best is None or len(changed) < len(best[1]):
            best = name, changed
    return "no preset" if best is None else one_line(", ".join([best[0], *best[1]]))
