"""JAX's environment variables that the user has set: which of them are taken back, and whether JAX
starts with the others.

What does not live here: what this package itself sets (`backend`). Nothing at module level imports
JAX, which reads its variables once, while it is imported.
"""

import contextlib
import os
import sys
from collections.abc import Mapping

from dronecombat_jax.errors import UserError

# JAX's own values, without which nothing here works, and the words that do no harm.
OFF, ON = (("0", "n", "no", "f", "false", "off"), ("1", "y", "yes", "t", "true", "on"))
CHECKS = ("ignore", ("ignore",))
TRANSFERS = ("allow", ("allow", "log", "log_explicit"))
FIXED: dict[str, tuple[bool | str, tuple[str, ...]]] = {
    "JAX_ENABLE_X64": (False, OFF),
    "JAX_NUMPY_DTYPE_PROMOTION": ("standard", ("standard",)),
    "JAX_NUMPY_RANK_PROMOTION": ("allow", ("allow",)),
    "JAX_DISABLE_JIT": (False, OFF),
    "JAX_USE_SHARDY_PARTITIONER": (True, ON),
    "JAX_TRANSFER_GUARD": TRANSFERS,
    "JAX_TRANSFER_GUARD_HOST_TO_DEVICE": TRANSFERS,
    "JAX_TRANSFER_GUARD_DEVICE_TO_HOST": TRANSFERS,
    "JAX_TRANSFER_GUARD_DEVICE_TO_DEVICE": TRANSFERS,
    "JAX_ERROR_CHECKING_BEHAVIOR_NAN": CHECKS,
    "JAX_ERROR_CHECKING_BEHAVIOR_DIVIDE": CHECKS,
    "JAX_ERROR_CHECKING_BEHAVIOR_OOB": CHECKS,
}
# With these JAX starts: its cache, and who meets whom (`processes.join` checks that).
HARMLESS = (
    "JAX_COMPILATION_CACHE",
    "JAX_PERSISTENT_CACHE",
    "JAX_COORDINATOR",
    "JAX_NUM_PROCESSES",
    "JAX_PROCESS_ID",
)


def fix() -> None:
    """Take back the variables that the user has set to other values than those of `FIXED`, and say
    so.
    """
    for name, (value, words) in FIXED.items():
        given = os.environ.get(name)
        if given is None or given.lower() in words:
            continue
        reason = f"training and fights need JAX's own value, {value}"
        print(f"note: {name}={given[:40]!r} is not used: {reason}", file=sys.stderr)
        del os.environ[name]
        if "jax" in sys.modules:  # it has read the environment already
            with contextlib.suppress(AttributeError):  # this version of it knows no such setting
                sys.modules["jax"].config.update(name.lower(), value)


def set_by_user(ours: Mapping[str, str]) -> str:
    """The variables that the user has set and with which JAX may not start, in words, or "".

    `ours`: what this package has set.
    """
    theirs = {
        name: value
        for name, value in os.environ.items()
        if name.startswith("JAX_") and not name.startswith(HARMLESS) and name not in FIXED
    }
    named = {name: value for name, value in theirs.items() if value not in (ours.get(name), "cpu")}
    return ", ".join(f"{name}={value[:40]!r}" for name, value in named.items())


def require_start(ours: Mapping[str, str]) -> None:
    """Raise UserError (exit 2) where JAX cannot be imported, has no device or makes no random
    number.

    `ours`: what this package has set; the message names what the user has.
    """
    try:
        import jax

        jax.devices()
        jax.random.key(0)
    except (AssertionError, RuntimeError, ValueError) as error:
        reason = " ".join(str(error).split())[:160] or "there is no such device on this machine"
        named = set_by_user(ours)
        fault = f"JAX does not start{' with ' if named else ''}{named} ({reason})"
        raise UserError(f"{fault}. Fix: unset what is wrong") from None


def require_float32() -> None:
    """Raise UserError (exit 2) where the user's own program has switched JAX to float64."""
    import jax

    if jax.config.jax_enable_x64:  # pyright: ignore[reportAttributeAccessIssue]
        raise UserError(
            "jax_enable_x64 is on, and the game and its networks compute in float32. "
            'Fix: jax.config.update("jax_enable_x64", False), or a process of their own'
        )
