"""Two Crazyflies learn to fight: a pursuit duel in MuJoCo MJX, IPPO and self-play in JAX.

    from dronecombat_jax import Combat, Config, load_run, load_policy, train, tournament

A name is loaded when it is first used, so that `import dronecombat_jax` alone starts no JAX.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dronecombat_jax.api import exploit as exploit
    from dronecombat_jax.api import load_config as load_config
    from dronecombat_jax.api import load_policy as load_policy
    from dronecombat_jax.api import load_run as load_run
    from dronecombat_jax.api import prepare as prepare
    from dronecombat_jax.api import rate as rate
    from dronecombat_jax.api import tournament as tournament
    from dronecombat_jax.api import train as train
    from dronecombat_jax.combat.env import Combat as Combat
    from dronecombat_jax.config.fields import Config as Config
    from dronecombat_jax.errors import UserError as UserError
    from dronecombat_jax.watch.replay import show as show

_ROOM = {
    "Combat": "combat.env",
    "Config": "config.fields",
    "UserError": "errors",
    "exploit": "api",
    "load_config": "api",
    "load_policy": "api",
    "load_run": "api",
    "prepare": "api",
    "rate": "api",
    "show": "watch.replay",
    "tournament": "api",
    "train": "api",
}
_NEEDS_JAX = ("Combat", "show")

__all__ = [
    "Combat",
    "Config",
    "UserError",
    "exploit",
    "load_config",
    "load_policy",
    "load_run",
    "prepare",
    "rate",
    "show",
    "tournament",
    "train",
]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _ROOM:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name in _NEEDS_JAX:
        import_module(f"{__name__}.api").prepare()
    return getattr(import_module(f"{__name__}.{_ROOM[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
