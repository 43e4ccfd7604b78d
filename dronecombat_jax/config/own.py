"""A choice by name: one of a table, or one of the user's own as MODULE:NAME.

Such as `--selfplay.sampler my_samplers:oldest_half`, with my_samplers.py in the folder where the
command runs, or installed. The name is stored with the run, and found again when it goes on.
"""

import os
import re
import sys
from collections.abc import Mapping
from importlib import import_module
from typing import TypeVar

from dronecombat_jax.errors import UserError

Choice = TypeVar("Choice")
OWN = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*", re.ASCII)


def chosen(table: Mapping[str, Choice], name: str) -> Choice:
    """The entry of `table`, or what MODULE:NAME names. UserError 2 where there is no such thing.

    Imports the module, which runs its code: only names from settings and runs come here, never one
    from a policy file.
    """
    if name in table:
        return table[name]
    module, _, attribute = name.partition(":")
    if os.getcwd() not in sys.path:  # a command's path begins with its own folder, not with ours
        sys.path.insert(0, os.getcwd())
    try:
        imported = import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module.split(".")[0] and error.name != module:
            raise
        raise UserError(f"{name}: no module {module} here or among the packages") from None
    if not hasattr(imported, attribute):
        raise UserError(f"{name}: {module} has no {attribute}")
    return getattr(imported, attribute)
