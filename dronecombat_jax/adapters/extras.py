"""What is said where a view's library is not installed."""

from dronecombat_jax.errors import UserError


def missing(library: str, extra: str) -> UserError:
    """The error to raise where `library` cannot be imported; `extra` is the one that brings it."""
    return UserError(
        f"{library} is not installed, and this view needs it: pip install 'dronecombat-jax[{extra}]'"
    )
