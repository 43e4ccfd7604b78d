"""Drawings alone: figures, tables, pages, pictures, films. Nothing here flies a fight or tests a
hypothesis.
"""

import contextlib
import os
import sys


def _import_matplotlib() -> None:
    """Import Matplotlib whatever MPLBACKEND names, and keep the user's choice where it can be kept.

    A notebook sets MPLBACKEND for all that it starts. Where the module named there is not
    installed, Matplotlib itself cannot be imported.
    """
    if "matplotlib" in sys.modules:
        return
    chosen = os.environ.pop("MPLBACKEND", None)
    try:
        import matplotlib
    finally:
        if chosen is not None:
            os.environ["MPLBACKEND"] = chosen
    if chosen:
        with contextlib.suppress(ValueError):
            matplotlib.rcParams["backend"] = chosen


_import_matplotlib()
