"""One setting as data: its key, type, range and how a value of it is checked, read and written.

What lives here: everything read off the fields of `dronecombat_jax.config.fields` (or of any
dataclass made of `setting` fields). What does not: files and flags (`settings`, `flags`), rules
that need more than one setting (`preflight`). Nothing imports JAX.
"""

import dataclasses
import json
import math
from dataclasses import dataclass
from typing import Any, Literal, get_args, get_origin, get_type_hints

from dronecombat_jax.config.own import OWN

MAX_TEXT = 1000
MAX_LAYERS = 16
_SHOWN = 80


@dataclass(frozen=True)
class Setting:
    """A leaf of the configuration, `key` being its dotted name ("learn.epochs")."""

    key: str
    kind: Literal["bool", "int", "float", "str", "ints", "choice"]
    default: Any
    doc: str
    unit: str
    low: float | None
    high: float | None
    low_open: bool
    choices: tuple[str, ...]
    own: bool = False  # MODULE:NAME is a choice, too
    file: str = ""  # a file with this suffix is a choice, too; "": none is

    @property
    def allowed(self) -> str:
        """What a value may be, to follow the words "must be"."""
        if self.kind == "bool":
            return "true or false"
        if self.kind == "choice":
            more = ", or MODULE:NAME of your own" if self.own else ""
            more += f", or a file of your own, NAME{self.file}" if self.file else ""
            return "one of " + ", ".join(self.choices) + more
        if self.kind == "str":
            return f"text on one line, at most {MAX_TEXT} characters"
        if self.kind == "ints":
            return f"a list of 1 to {MAX_LAYERS} integers{self._range()}"
        noun = "an integer" if self.kind == "int" else "a number"
        return noun + self._range() + (f" {self.unit}" if self.unit else "")

    @property
    def explained(self) -> str:
        """One line for people: what it is, its unit and its range."""
        notes = ", ".join(part for part in (self.unit, self._range().strip()) if part)
        return f"{self.doc} [{notes}]" if notes else self.doc

    def problem(self, value: Any) -> str | None:
        """Why `value` is not allowed, or None; True is no integer and 3 is a fine float."""
        fault = f"must be {self.allowed}"
        if self.kind == "bool":
            return None if isinstance(value, bool) else fault
        if self.kind == "choice":
            return None if isinstance(value, str) and self._is_choice(value) else fault
        if self.kind == "str":
            fine = isinstance(value, str) and len(value) <= MAX_TEXT and value.isprintable()
            return None if fine else fault
        if self.kind == "ints":
            fine = isinstance(value, list | tuple) and 1 <= len(value) <= MAX_LAYERS
            return None if fine and all(self._number_fits(item, int) for item in value) else fault
        if self._number_fits(value, int if self.kind == "int" else float):
            return None
        return fault + _hint(self.kind, value)

    def normal(self, value: Any) -> Any:
        """A value without a problem in the type that the dataclass declares."""
        if self.kind == "float":
            return float(value)
        return tuple(value) if self.kind == "ints" else value

    def from_text(self, text: str | tuple[str, ...]) -> Any:
        """The value that a command-line word stands for; the word itself where it stands for none."""
        if isinstance(text, tuple):
            return tuple(_number(word, int) for word in text)
        if self.kind in ("int", "float"):
            return _number(text, int if self.kind == "int" else float)
        return str(text)

    def _is_choice(self, value: str) -> bool:
        if value in self.choices or (self.own and OWN.fullmatch(value)):
            return True
        name = bool(self.file) and value.endswith(self.file) and len(value) <= MAX_TEXT
        return name and value.isprintable()

    def _number_fits(self, value: Any, kind: type) -> bool:
        if isinstance(value, bool) or not isinstance(value, int if kind is int else int | float):
            return False
        if isinstance(value, float) and not math.isfinite(value):
            return False
        above = self.low is None or (value > self.low if self.low_open else value >= self.low)
        return above and (self.high is None or value <= self.high)

    def _range(self) -> str:
        if self.low is None or self.high is None:
            return ""
        if self.low_open:
            return f" above {_bound(self.low)}, at most {_bound(self.high)}"
        return f" from {_bound(self.low)} to {_bound(self.high)}"


def settings_of(cls: type, prefix: str = "") -> dict[str, Setting]:
    """Every leaf setting of the dataclass `cls` by dotted key, in the order of declaration."""
    entries: dict[str, Setting] = {}
    hints = get_type_hints(cls)
    for item in dataclasses.fields(cls):
        hint, key = hints[item.name], prefix + item.name
        if dataclasses.is_dataclass(hint):
            entries |= settings_of(hint, key + ".")  # pyright: ignore[reportArgumentType]
        else:
            entries[key] = _setting(key, hint, item)
    return entries


def build(cls: type, values: dict[str, Any], prefix: str = "") -> Any:
    """An instance of `cls` from checked values by dotted key; defaults for what is missing."""
    hints = get_type_hints(cls)
    arguments = {}
    for item in dataclasses.fields(cls):
        hint, key = hints[item.name], prefix + item.name
        if dataclasses.is_dataclass(hint):
            arguments[item.name] = build(hint, values, key + ".")  # pyright: ignore[reportArgumentType]
        elif key in values:
            arguments[item.name] = values[key]
    return cls(**arguments)


def flatten(config: Any, prefix: str = "") -> dict[str, Any]:
    """Every leaf value of a dataclass instance by dotted key, in the order of declaration."""
    values: dict[str, Any] = {}
    for item in dataclasses.fields(config):
        value, key = getattr(config, item.name), prefix + item.name
        values |= flatten(value, key + ".") if dataclasses.is_dataclass(value) else {key: value}
    return values


def written(value: Any) -> str:
    """A value as TOML spells it, so that reading it gives the same value again."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # JSON leaves DEL alone and TOML does not allow it bare.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return "[" + ", ".join(written(item) for item in value) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {written(item)}" for key, item in value.items()) + "}"
    return repr(value) if isinstance(value, int | float) else str(value)


def shown(value: Any) -> str:
    """A value for a message: as in TOML, on one line, printable and not longer than the message."""
    try:
        text = written(value)
    except (ValueError, RecursionError):  # integers of 5000 digits, arrays a thousand deep
        text = f"({type(value).__name__})"
    return one_line(text)


def one_line(text: str) -> str:
    """Foreign text for a message: printable, and not longer than the message."""
    text = "".join(c if c.isprintable() else "?" for c in text)
    return text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "..."


def _setting(key: str, hint: Any, item: dataclasses.Field) -> Setting:
    """The `Setting` of one dataclass field; TypeError for a type that has no reader yet."""
    choices: tuple[str, ...] = get_args(hint) if get_origin(hint) is Literal else ()
    kinds: dict[Any, Any] = {
        bool: "bool",
        int: "int",
        float: "float",
        str: "str",
        tuple[int, ...]: "ints",
    }
    kind = "choice" if choices else kinds.get(hint)
    if kind is None:
        raise TypeError(f"{key}: settings of type {hint} are not supported")
    data = item.metadata
    return Setting(
        key,
        kind,
        item.default,
        data["doc"],
        data["unit"],
        data["low"],
        data["high"],
        data["low_open"],
        choices,
        data["own"],
        data["file"],
    )


def _number(word: str, kind: type) -> Any:
    try:
        return kind(word) if word.isascii() and word == word.strip() else word
    except ValueError:
        return word


def _hint(kind: str, value: Any) -> str:
    """The correction that the writer most likely meant, where there is one."""
    number = _number(value, float) if isinstance(value, str) else value
    if not isinstance(number, float) or not math.isfinite(number):
        return ""
    if kind == "int" and number.is_integer() and abs(number) < 1e15:
        return f"; write {int(number)}"
    if kind == "float" and isinstance(value, str):
        return f"; write {value} without quotes"
    return ""


def _bound(number: float) -> str:
    return str(int(number)) if number == int(number) and abs(number) < 1e13 else f"{number:g}"
