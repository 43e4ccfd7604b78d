"""Which version of this package wrote a file.

What does not live here: the versions that are refused (`machine.backend`).
"""

from importlib import metadata


def package_version() -> str:
    """The version of this package, as installed."""
    try:
        return metadata.version("dronecombat-jax")
    except metadata.PackageNotFoundError:
        return "unknown"
