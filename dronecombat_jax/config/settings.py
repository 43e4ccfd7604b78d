"""From defaults, a preset file and flags to one checked `Config`, and back to TOML.

Defaults < file < flags. All mistakes are reported at once, one line each, with file, line, key,
value and what is allowed. What does not live here: the settings themselves (`fields`), the check of
one value (`schema`), rules across settings (`preflight`). Nothing imports JAX or MuJoCo.
"""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from dronecombat_jax.config import body_file, flight_rules, opponent_rules, opponents, preflight
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.preset_text import lines_of, syntax_error, text_of
from dronecombat_jax.config.schema import (
    Setting,
    build,
    flatten,
    one_line,
    settings_of,
    shown,
    written,
)
from dronecombat_jax.config.suggest import suggestion
from dronecombat_jax.errors import UserError

SCHEMA: dict[str, Setting] = settings_of(Config)
SECTIONS: tuple[str, ...] = tuple(dict.fromkeys(key.split(".")[0] for key in SCHEMA))


class Given(NamedTuple):
    """A value that somebody wrote, and where: "duel.toml:3" or the flag "--train.seed"."""

    value: Any
    where: str

    def quoted(self, key: str) -> str:
        """The value in its place, to open a message."""
        if self.where.startswith("--"):
            bare = isinstance(self.value, str) and self.value
            return f"{self.where} {one_line(self.value) if bare else shown(self.value)}"
        return f"{self.where}: {key} = {shown(self.value)}"


def load(
    preset: str | Path | None = None,
    overrides: Mapping[str, Any] | None = None,
    *,
    check_machine: bool = False,
) -> Config:
    """The configuration of defaults < `preset` (a name or a .toml file) < `overrides` (dotted
    keys).

    `check_machine`: refuse what cannot be trained here; a run from a larger machine can still be
    looked at. Raises UserError (exit 2) whose message has one line per mistake.
    """
    errors: list[str] = []
    given: dict[str, Given] = {}
    try:
        given |= read(find_preset(preset)) if preset is not None else {}
    except UserError as error:
        errors += error.message.splitlines()
    given |= {key: Given(value, flag(key)) for key, value in (overrides or {}).items()}
    return _checked(given, errors, check_machine)


def from_toml(text: str, source: str) -> Config:
    """The configuration that `to_toml` once wrote as `text`; `source` opens the messages. Raises
    UserError as `load`.
    """
    return _checked(_values(text, source), [], check_machine=False)


def checked(config: Config) -> Config:
    """Check a configuration that a program made as `load` checks a written one, and whether this
    machine can train it; returns it. UserError.
    """
    given = {key: Given(value, flag(key)) for key, value in flatten(config).items()}
    return _checked(given, [], check_machine=True)


def _machine_problems(config: Config) -> list[preflight.Problem]:
    if opponent_rules.misspelt(config):
        return []  # nobody knows what it would take
    return [
        *preflight.memory_problems(config),
        *preflight.disk_problems(config),
        *preflight.package_problems(config),
        *flight_rules.body_problems(config),
    ]


def _checked(given: Mapping[str, Given], errors: list[str], check_machine: bool) -> Config:
    """The configuration of `given` over the defaults, or a UserError of `errors` and whatever else
    is wrong.
    """
    errors = [*errors, *check(given, SCHEMA)]
    if errors:
        raise UserError("\n".join(errors))
    config: Config = build(
        Config, {key: SCHEMA[key].normal(item.value) for key, item in given.items()}
    )
    broken = preflight.problems(config) + (_machine_problems(config) if check_machine else [])
    if broken:
        raise UserError("\n".join(_placed(problem, given) for problem in broken))
    return config


def check(given: Mapping[str, Given], schema: Mapping[str, Setting]) -> list[str]:
    """One line for every unknown key and every value that its setting does not allow."""
    errors = []
    sections = list(dict.fromkeys(key.split(".")[0] for key in schema))
    for key, item in given.items():
        if key in schema:
            fault = schema[key].problem(item.value)
        elif key in sections:
            fault = f"{key} is a section; write its settings under [{key}]"
        else:
            fault = f"unknown setting; {suggestion(key, schema if '.' in key else [*schema, *sections])}"
        if fault:
            errors.append(f"{item.quoted(key)}: {fault}")
    return errors


def read(path: Path) -> dict[str, Given]:
    """The values in a TOML file by dotted key, unchecked; UserError where it is not TOML or too
    large.
    """
    return _values(text_of(path), str(path))


def _values(text: str, source: str) -> dict[str, Given]:
    """The values in the TOML document `text` by dotted key."""
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise UserError(syntax_error(source, error)) from None
    if not document:
        raise UserError(
            f"{source}: the file is empty; it needs at least one section such as [train]"
        )
    lines = lines_of(text)
    values: dict[str, Given] = {}
    for name, content in document.items():
        known = name in SECTIONS and isinstance(content, dict)
        entries = (
            {f"{name}.{key}": value for key, value in content.items()} if known else {name: content}
        )
        for key, value in entries.items():
            line = lines.get(key) or lines.get(name)
            values[key] = Given(value, f"{source}:{line}" if line else source)
    return values


def presets() -> dict[str, Path]:
    """The presets that come with the package, by name: in a wheel, or in the checkout around it."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "experiments", package.parent / "experiments"):
        if files := sorted(folder.glob("*.toml")):
            return {path.stem: path for path in files}
    return {}


def find_preset(preset: str | Path) -> Path:
    """The file of a preset: a path if it has a folder or ends in .toml, a name otherwise."""
    if not str(preset).isprintable() or not str(preset):
        raise UserError(f"--preset {shown(str(preset))}: must be a name or a file, on one line")
    if isinstance(preset, Path) or preset.endswith(".toml") or "/" in preset or "\\" in preset:
        return Path(preset)
    if preset not in (known := presets()):
        raise UserError(f"--preset {shown(preset)}: no such preset; {suggestion(preset, known)}")
    return known[preset]


def to_toml(config: Config) -> str:
    """The whole configuration as TOML, with a comment on every setting; `load` reads it back
    exactly.
    """
    values = flatten(config)
    blocks = []
    for section in SECTIONS:
        about = (type(getattr(config, section)).__doc__ or "").splitlines()[0]
        lines = [f"# {about}", f"[{section}]"]
        for key, entry in SCHEMA.items():
            if key.startswith(section + "."):
                choices = f" [{entry.allowed}]" if entry.choices else ""
                lines += [
                    f"# {entry.explained}{choices}",
                    f"{key.split('.')[1]} = {written(values[key])}",
                ]
        blocks.append("\n".join(lines))
    return "\n\n".join(blocks) + "\n"


def diff(a: Config, b: Config) -> list[tuple[str, Any, Any]]:
    """The settings in which two configurations differ: (dotted key, value in a, value in b)."""
    first, second = flatten(a), flatten(b)
    return [(key, first[key], second[key]) for key in first if first[key] != second[key]]


def run_name(config: Config, preset: str | Path) -> str:
    """`run.name`, or method-preset where it is empty ("ippo-duel")."""
    method = opponents.method(config).replace("-", "")
    stem = re.sub(r"[^A-Za-z0-9._-]+", "-", Path(preset).name.removesuffix(".toml"))
    return config.run.name or f"{method}-{stem}"[:100]


def as_run(config: Config, preset: str | Path) -> Config:
    """The settings as a run stores them: with its name, and with the whole paths of an own drone.

    So the run can be gone on with, and looked at, from any folder.
    """
    whole = lambda path: str(Path(path).expanduser().absolute())
    own: Any = whole(config.sim.body) if body_file.is_file(config.sim.body) else config.sim.body
    return replace(
        config,
        run=replace(config.run, name=run_name(config, preset)),
        sim=replace(config.sim, mjcf=config.sim.mjcf and whole(config.sim.mjcf), body=own),
    )


def flag(key: str) -> str:
    """The command-line spelling of a dotted key."""
    return "--" + key.replace("_", "-")


def _placed(problem: preflight.Problem, given: Mapping[str, Given]) -> str:
    """The message of a broken rule, opened by where a setting of it was given: a flag before a
    file.
    """
    written_down = [given[key].where for key in problem.keys if key in given]
    flags = [where for where in written_down if where.startswith("--")]
    where = next(iter(flags or written_down), None)
    return f"{where}: {problem.message}" if where else problem.message
