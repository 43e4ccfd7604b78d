"""Command-line flags made from a dataclass of settings: argparse splits and explains, `schema`
checks.

Every flag reaches the same check as the same key in a file, so that both give the same message.
What does not live here: the commands (`cli`). Nothing imports JAX.
"""

import argparse
import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from dronecombat_jax.config.schema import Setting, one_line, settings_of, shown, written
from dronecombat_jax.config.settings import Given, check, flag, suggestion
from dronecombat_jax.errors import UserError

_METAVARS = {"int": "INT", "float": "NUMBER", "str": "TEXT", "ints": "INT"}
_NEGATIVE = re.compile(r"-\.?\d")  # argparse takes -1e-3 for a flag


def parse(
    cls: type,
    args: Sequence[str],
    prog: str,
    *,
    aliases: Mapping[str, str] | None = None,
    positional: str = "",
) -> tuple[dict[str, Any], list[str]]:
    """The settings of `cls` that `args` give, by dotted key, unchecked; and a line for each flag
    that does not exist.

    `aliases`: short flag by key. `positional`: the key given without a flag. Prints and leaves with
    SystemExit(0) for `--help`; UserError for a flag without its value.
    """
    schema, aliases = settings_of(cls), dict(aliases or {})
    parser = _parser(cls, schema, prog, aliases, positional)
    given, rest = parser.parse_known_args(_words(args))
    words = dict(vars(given))
    bare = [word for word in rest if not word.startswith("-")]
    if positional and bare:
        words[positional] = bare[0]
        rest.remove(bare[0])
    values = {key: _value(entry, words[key]) for key, entry in schema.items() if key in words}
    schema.pop(positional, None)
    return values, list(_unknown(rest, list(args), schema, aliases))


def read(cls: type, args: Sequence[str], prog: str, *, positional: str = "") -> Any:
    """An instance of the flat dataclass `cls` from flags alone; UserError names every mistake."""
    values, errors = parse(cls, args, prog, positional=positional)
    schema = settings_of(cls)
    name = lambda key: key.upper() if key == positional else flag(key)
    given = {key: Given(value, name(key)) for key, value in values.items()}
    errors += check(given, schema)
    if errors:
        raise UserError("\n".join(errors))
    return cls(**{key: schema[key].normal(value) for key, value in values.items()})


def _value(entry: Setting, given: Any) -> Any:
    """The value of a flag as argparse returns it: a switch, a word, or the words of a list."""
    if isinstance(given, bool):
        return given
    return entry.from_text(tuple(given) if isinstance(given, list) else given)


class _Parser(argparse.ArgumentParser):
    """A parser that raises UserError with one line, where argparse prints its usage and exits."""

    def error(self, message: str) -> Any:
        name, _, fault = message.removeprefix("argument ").partition(": ")
        names = name.split("/")
        if fault.startswith("expected"):
            raise UserError(f"{names[0]}: the value is missing")
        if fault.startswith("ignored explicit argument"):
            raise UserError(_no_value(fault.partition("'")[2].rstrip("'"), *names))
        raise UserError(one_line(message))


class _Switch(argparse.Action):
    """An on-off setting: the first of its two flags switches it on, the second off."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: Any = None) -> None:
        setattr(namespace, self.dest, option_string == self.option_strings[0])


def _parser(
    cls: type, schema: dict[str, Setting], prog: str, aliases: dict[str, str], positional: str
) -> _Parser:
    """The parser: one group of flags for each section of `cls`; a flag that is not given sets
    nothing.
    """
    place = f" {positional.upper()}" if positional else ""
    about = inspect.cleandoc(cls.__doc__ or "")
    if positional:
        about += f"\n\n{positional.upper()}: {schema[positional].doc}"
    parser = _Parser(
        prog=prog,
        usage=f"{prog}{place} [flags]",
        description=about,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        argument_default=argparse.SUPPRESS,
        allow_abbrev=False,
    )
    groups: dict[str, Any] = {"": parser}
    for key, entry in schema.items():
        section = key.rpartition(".")[0]
        if section not in groups:
            groups[section] = parser.add_argument_group(section)
        if key != positional:
            _add(groups[section], key, entry, aliases.get(key))
    return parser


def _add(group: Any, key: str, entry: Setting, alias: str | None) -> None:
    default = "" if entry.default == "" else f" (default: {_plain(entry.default)})"
    about = (entry.explained + default).replace("%", "%%")
    if entry.kind == "bool":
        group.add_argument(flag(key), _negated(key), dest=key, action=_Switch, nargs=0, help=about)
        return
    metavar = _METAVARS.get(entry.kind) or "{" + ",".join(entry.choices) + "}"
    names = [flag(key), *([alias] if alias else [])]
    several = "*" if entry.kind == "ints" else None
    group.add_argument(*names, dest=key, metavar=metavar, nargs=several, help=about)


def _words(args: Sequence[str]) -> list[str]:
    """The words as argparse takes them: dashes in names, negative numbers joined to their flag."""
    words: list[str] = []
    for word in args:
        if words and _NEGATIVE.match(word) and words[-1].startswith("--") and "=" not in words[-1]:
            words[-1] += "=" + word
        else:
            words.append(_dashed(word))
    return words


def _dashed(word: str) -> str:
    """`--skip_bad=x` as `--skip-bad=x`."""
    name, equals, value = word.partition("=")
    return name.replace("_", "-") + equals + value if word.startswith("--") else word


def _negated(key: str) -> str:
    """The flag that switches `key` off: --run.no-video."""
    *sections, leaf = key.split(".")
    return flag(".".join([*sections, "no-" + leaf]))


def _unknown(
    rest: list[str], args: list[str], schema: dict[str, Setting], aliases: Mapping[str, str]
) -> Iterator[str]:
    """One line for every flag that does not exist and every word that belongs to no flag."""
    switches = {
        name: key
        for key, entry in schema.items()
        if entry.kind == "bool"
        for name in (flag(key), _negated(key))
    }
    after_unknown = False
    for word in rest:
        before = _dashed(args[args.index(word) - 1]) if word in args[1:] else ""
        if word.startswith("-") and not word[1:2].isdigit():
            name = word.partition("=")[0]
            yield f"{one_line(name)}: unknown flag; {_flag_meant(name, list(schema), aliases)}"
            after_unknown = True
        elif switch := switches.get(before):
            yield _no_value(word, flag(switch), _negated(switch))
        elif not after_unknown:
            yield f"{shown(word)}: belongs to no flag"


def _no_value(word: str, on: str, off: str) -> str:
    return f"{shown(word)}: an on-off flag takes no value; write {on} or {off}"


def _flag_meant(name: str, known: list[str], aliases: Mapping[str, str]) -> str:
    plain = name.lstrip("-").replace("-", "_").replace(".no_", ".")
    meant = suggestion(plain, [*known, *(alias.lstrip("-") for alias in aliases.values())])
    if meant.startswith("did you mean "):
        return "did you mean " + flag(meant.removeprefix("did you mean ").removesuffix("?")) + "?"
    return "--help lists them all"


def _plain(value: Any) -> str:
    """A default for `--help`: no quotes, no brackets, six digits."""
    if isinstance(value, tuple):
        return " ".join(map(str, value))
    return f"{value:g}" if isinstance(value, float) else written(value).strip('"')
