"""Views of the environment for other libraries, and a checker of such views.

    from dronecombat_jax.adapters import check

What does not live here: the environment (`combat`).
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dronecombat_jax.adapters.conformance import NonConforming as NonConforming
    from dronecombat_jax.adapters.conformance import check as check
    from dronecombat_jax.adapters.conformance import examine as examine

__all__ = ["NonConforming", "check", "examine"]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from dronecombat_jax.adapters import conformance

    return getattr(conformance, name)
