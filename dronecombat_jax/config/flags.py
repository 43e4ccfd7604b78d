"""Command-line flags made from a dataclass of settings: tyro splits and explains, `schema` checks.

Every flag reaches the same check as the same key in a file, so that both give the same message.
What does not live here: the commands (`cli`). Nothing imports JAX; tyro is imported when flags are
read.
"""

import contextlib
import dataclasses
import io
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, get_type_hints

from dronecombat_jax.config.schema import Setting, one_line, settings_of, shown, written
from dronecombat_jax.config.settings import Given, check, flag, suggestion
from dronecombat_jax.errors import UserError

_METAVARS = {"int": "INT", "float": "NUMBER", "str": "TEXT", "ints": "INT [INT ...]"}


def parse(
    cls: type,
    args: Sequence[str],
    prog: str,
    *,
    aliases: Mapping[str, str] | None = None,
    positional: str = "",
) -> tuple[dict[str, Any], list[str]]:
    """The settings of `cls` that `args` give, by dotted key, unchecked, and a line per flag it
    lacks.

    `aliases`: short flag by key. `positional`: the key given without a flag. Prints and leaves with
    SystemExit(0) for `--help`; UserError for a flag without its value.
    """
    import tyro  # 0.1 s that `dronecombat --help` need not pay

    schema = settings_of(cls)
    make = _maker(schema, dict(aliases or {}), positional)
    errors = io.StringIO()
    try:
        with contextlib.redirect_stderr(errors):
            parsed, unknown = tyro.cli(
                _mirror(cls, make),
                prog=prog,
                description=cls.__doc__,
                args=list(args),
                return_unknown_args=True,
            )
    except SystemExit as stop:
        if stop.code:
            raise UserError(_one_line(errors.getvalue())) from None
        raise
    words = {key: word for key, word in _leaves(parsed).items() if word is not None}
    values = {
        key: schema[key].from_text(word)
        for key, word in words.items()
        if schema[key].kind != "bool"
    }
    values |= _switches(schema, words, args)
    schema.pop(positional, None)
    return values, _unknown_flags(unknown, list(args), schema, aliases or {})


def read(cls: type, args: Sequence[str], prog: str, *, positional: str = "") -> Any:
    """An instance of the flat dataclass `cls` from flags alone; UserError names every mistake."""
    values, errors = parse(cls, args, prog, positional=positional)
    schema = settings_of(cls)
    given = {
        key: Given(value, key.upper() if key == positional else flag(key))
        for key, value in values.items()
    }
    errors += check(given, schema)
    if errors:
        raise UserError("\n".join(errors))
    return cls(**{key: schema[key].normal(value) for key, value in values.items()})


def _maker(
    schema: dict[str, Setting], aliases: dict[str, str], positional: str
) -> Callable[[str], tuple[Any, Any]]:
    """A function from a dotted key to the type and default that tyro shall see for it."""
    import tyro

    def make(key: str) -> tuple[Any, Any]:
        entry = schema[key]
        if key == positional:
            about = tyro.conf.arg(metavar=key.upper(), help=entry.doc, help_behavior_hint="")
            return Annotated[tyro.conf.Positional[str | None], about], None
        about = tyro.conf.arg(
            metavar=None
            if entry.kind == "bool"
            else _METAVARS.get(entry.kind) or "{" + ",".join(entry.choices) + "}",
            help=entry.explained,
            help_behavior_hint="" if entry.default == "" else f"(default: {_plain(entry.default)})",
            aliases=(aliases[key],) if key in aliases else None,
        )
        if entry.kind == "bool":
            return Annotated[bool, about], entry.default
        words = tuple[str, ...] if entry.kind == "ints" else str
        return Annotated[words | None, about], None

    return make


def _mirror(cls: type, make: Callable[[str], tuple[Any, Any]], prefix: str = "") -> Any:
    """A dataclass shaped like `cls` whose fields are the words of the command line, None where not
    given.
    """
    hints, fields = get_type_hints(cls), []
    for item in dataclasses.fields(cls):
        hint = hints[item.name]
        if dataclasses.is_dataclass(hint):
            inner = _mirror(hint, make, prefix + item.name + ".")  # pyright: ignore[reportArgumentType]
            fields.append((item.name, inner, dataclasses.field(default_factory=inner)))
        else:
            fields.append((item.name, *make(prefix + item.name)))
    return dataclasses.make_dataclass(cls.__name__, fields, namespace={"__doc__": cls.__doc__})


def _leaves(parsed: Any, prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for item in dataclasses.fields(parsed):
        value, key = getattr(parsed, item.name), prefix + item.name
        found |= _leaves(value, key + ".") if dataclasses.is_dataclass(value) else {key: value}
    return found


def _switches(
    schema: dict[str, Setting], words: dict[str, Any], args: Sequence[str]
) -> dict[str, bool]:
    """The on-off flags that were given; tyro does not tell a given one from its default."""
    present = {word.replace("_", "-") for word in args}
    return {
        key: words[key]
        for key, entry in schema.items()
        if entry.kind == "bool" and present & {flag(key), _negated(key)}
    }


def _negated(key: str) -> str:
    """The flag that switches `key` off: --run.no-video."""
    *sections, leaf = key.split(".")
    return flag(".".join([*sections, "no-" + leaf]))


def _unknown_flags(
    unknown: list[str], args: list[str], schema: dict[str, Setting], aliases: Mapping[str, str]
) -> list[str]:
    """One line for every flag that does not exist and every word that belongs to no flag."""
    switches = {
        name: key
        for key in schema
        if schema[key].kind == "bool"
        for name in (flag(key), _negated(key))
    }
    errors, after_unknown = [], False
    for word in unknown:
        before = args[args.index(word) - 1].replace("_", "-") if word in args[1:] else ""
        joined = next(
            (arg.partition("=")[0] for arg in args if arg.endswith("=" + word)), ""
        ).replace("_", "-")
        if word.startswith("-") and not word[1:2].isdigit():
            name = word.partition("=")[0]
            errors.append(
                f"{one_line(name)}: unknown flag; {_flag_meant(name, list(schema), aliases)}"
            )
            after_unknown = True
        elif switch := switches.get(before) or switches.get(joined):
            errors.append(
                f"{shown(word)}: an on-off flag takes no value; write {flag(switch)} or {_negated(switch)}"
            )
        elif not after_unknown:
            errors.append(f"{shown(word)}: belongs to no flag")
    return errors


def _flag_meant(name: str, known: list[str], aliases: Mapping[str, str]) -> str:
    plain = name.lstrip("-").replace("-", "_").replace(".no_", ".")
    meant = suggestion(plain, [*known, *(alias.lstrip("-") for alias in aliases.values())])
    if meant.startswith("did you mean "):
        return "did you mean " + flag(meant.removeprefix("did you mean ").removesuffix("?")) + "?"
    return "--help lists them all"


def _one_line(box: str) -> str:
    """The sentence inside the frame that tyro draws around an error."""
    if missing := re.search(r"Missing value for argument '(?:[^']*/)?([^'/]+)'", box):
        return f"{missing[1]}: the value is missing"
    rows = [row.strip(" │\n") for row in box.splitlines()]
    inside = [row for row in rows if row and not row.startswith("╭")]
    end = next((i for i, row in enumerate(inside) if row.startswith(("─", "╰"))), len(inside))
    return " ".join(inside[:end]) or "the command line cannot be read; see --help"


def _plain(value: Any) -> str:
    """A default for `--help`: no quotes, no brackets, six digits."""
    if isinstance(value, tuple):
        return " ".join(map(str, value))
    return f"{value:g}" if isinstance(value, float) else written(value).strip('"')
