"""How fights end over training, a panel for each variant of a study, from what is kept of it.

    python experiments/curves.py experiments/studies/real.toml --out real.png [--only NAME ...]

Thick: the mean over seeds; thin: each seed. The runs themselves need not be there
(`studies/STUDY.jsonl`, `experiments/variants.py`).
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import measured
import variants
from kept import Kept
from panels import in_panels

from dronecombat_jax.report.figures import OUTCOMES, ROLE_COLOURS, save_figure

# isort: split
# After the report, which imports Matplotlib whatever MPLBACKEND names.
from matplotlib.axes import Axes
from matplotlib.figure import Figure

LINES = {  # of `measured.NAMES`: colour, dashes
    "intercepted": (OUTCOMES["intercept"][1], "-"),
    "reached": (OUTCOMES["reached"][1], "-"),
    "timeout": (OUTCOMES["both_crash"][1], "-"),
    "defender down": (ROLE_COLOURS["defender"], ":"),
    "attacker down": (ROLE_COLOURS["attacker"], ":"),
}


def panels(study: variants.Study, kept: Kept) -> list[tuple[str, list[dict[str, Any]]]]:
    """Title and the measures of all seeds of each variant that has any."""
    found = []
    for variant in study.variants:
        runs = [kept.find(variant.name, seed, variant.changed) for seed in variant.seeds]
        if whole := [run for run in runs if run is not None]:
            title = f"{variant.name}: {variant.about}".rstrip(": ").replace("`", "")
            found.append((title, whole))
    return found


def draw(shown: Sequence[tuple[str, list[dict[str, Any]]]]) -> Figure:
    """The figure; at least one panel."""
    return in_panels(
        [title for title, _ in shown], lambda ax, number: draw_panel(ax, shown[number][1])
    )


def draw_panel(ax: Axes, runs: Sequence[dict[str, Any]]) -> None:
    """One variant, its seeds' curves up to the shortest one's end in the mean."""
    for name in measured.NAMES:
        colour, dashes = LINES[name]
        each = [share_of(run, name) for run in runs]
        shortest = min(map(len, each))
        for curve in each if len(each) > 1 else ():
            ax.plot(
                steps_of(curve), curve, color=colour, linestyle=dashes, linewidth=0.6, alpha=0.6
            )
        mean = np.mean([curve[:shortest] for curve in each], axis=0)
        ax.plot(steps_of(mean), mean, color=colour, linestyle=dashes, linewidth=2.0, label=name)
    ax.set_xlim(left=0.0)
    ax.grid(alpha=0.3)


def share_of(run: dict[str, Any], name: str) -> np.ndarray:
    """A share in each window of a run, NaN where no fight ended."""
    shares = [window[name] for window in run["curve"]]
    return np.array([np.nan if share is None else share for share in shares])


def steps_of(curve: np.ndarray) -> np.ndarray:
    """The middle of each window, in millions of environment steps."""
    return (np.arange(len(curve)) + 0.5) * measured.WINDOW / 1e6


def main() -> int:
    """Read the study and what is kept of it, draw; 1 where nothing is."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("study", type=Path, help="a study file")
    parser.add_argument("--out", type=Path, required=True, help="the picture to write")
    parser.add_argument(
        "--only", nargs="+", default=(), metavar="NAME", help="these variants alone"
    )
    flags = parser.parse_args()
    study = variants.read_study(flags.study)
    chosen = tuple(v for v in study.variants if not flags.only or v.name in flags.only)
    shown = panels(study._replace(variants=chosen), Kept(flags.study))
    if not shown:
        print(f"{flags.study}: nothing is kept of it", file=sys.stderr)
        return 1
    save_figure(draw(shown), flags.out)
    print(f"drawn: {flags.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
