"""Learning curves: what is averaged, and every awkward run that must still give a picture."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from dronecombat_jax.errors import EXIT_CANNOT_WRITE, EXIT_DATA, UserError
from dronecombat_jax.report import figures
from dronecombat_jax.report.figures import OUTCOMES, gather, learning_curves
from dronecombat_jax.types import SIDES, Cause


def record(
    seed: int, iteration: int, episodes: int, reached: float | None, **more: Any
) -> dict[str, Any]:
    values: dict[str, Any] = {
        "iteration": iteration,
        "steps": 100 * iteration,
        "seed": seed,
        "episodes": episodes,
    }
    values |= {f"outcome/{name}": None if reached is None else 0.0 for name in OUTCOMES}
    if reached is not None:
        values |= {
            "outcome/reached": reached,
            "outcome/timeout": 1.0 - reached,
            "episode_steps": 50.0 * iteration,
        }
        values |= {"win/attacker": reached, "win/draw": 1.0 - reached, "win/defender": 0.0}
    for role in SIDES:
        values |= {f"kl/{role}": 0.008, f"learning_rate/{role}": 3e-4, f"log_std/{role}": -0.1}
        values |= {
            f"explained_variance/{role}": -5.0,
            f"return/{role}": None,
            f"crash/{role}": reached,
        }
    return values | more


DRAW = """
import json, sys
from pathlib import Path
from dronecombat_jax.tournaments import comparison
from dronecombat_jax.report import figures, tournament_report
from dronecombat_jax.watch import finish
import matplotlib
figures.learning_curves(json.loads(sys.argv[1]), Path(sys.argv[2]), "title")
chosen = dict.__getitem__(matplotlib.rcParams, "backend")
print(chosen)
"""


@pytest.mark.parametrize(
    "named",
    [
        "nonsense",
        pytest.param("module://matplotlib_inline.backend_inline", marks=pytest.mark.slow),
        pytest.param("pdf", marks=pytest.mark.slow),
    ],
)
@pytest.mark.long
def test_figures_are_drawn_whatever_mplbackend_names(named: str, tmp_path: Path):
    """A notebook sets it for all that it starts; a choice that is there is kept for the user."""
    command = [
        sys.executable,
        "-c",
        DRAW,
        json.dumps([record(0, 1, 3, 0.5)]),
        str(tmp_path / "a.png"),
    ]
    environment = os.environ | {"MPLBACKEND": named}
    result = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "a.png").stat().st_size > 5000 and (tmp_path / "a.pdf").is_file()
    assert named != "pdf" or result.stdout == "pdf\n"


def test_every_ending_has_its_colour():
    assert set(OUTCOMES) == {cause.name.lower() for cause in Cause if cause != Cause.NONE}


def test_gather_aligns_seeds_and_keeps_gaps():
    """Out of order, seed 7 without its second iteration, a null share: rows are seeds, gaps NaN."""
    curves = gather([record(7, 1, 4, 0.5), record(3, 2, 4, None), record(3, 1, 4, 0.25)])
    assert curves.seeds == [3, 7]
    np.testing.assert_array_equal(curves.steps, [100, 200])
    np.testing.assert_array_equal(curves.values["outcome/reached"], [[0.25, np.nan], [0.5, np.nan]])
    np.testing.assert_array_equal(curves.values["kl/defender"], [[0.008, 0.008], [0.008, np.nan]])


def test_bins_weigh_shares_by_the_fights_that_ended(monkeypatch: pytest.MonkeyPatch):
    """Two bins of two: (1 of 1, 0 of 3) is 1/4 of the fights; (null, 1 of 2) is 1/2; learning rates
    weigh the same.
    """
    monkeypatch.setattr(figures, "MOST_POINTS", 2)
    rates = (1.0, 3.0, 5.0)
    shares = ((1, 1.0), (3, 0.0), (0, None))
    records = [
        record(0, i + 1, n, share, **{"learning_rate/defender": rate})
        for i, ((n, share), rate) in enumerate(zip(shares, rates, strict=True))
    ]
    curves = gather(records)
    np.testing.assert_array_equal(curves.steps, [200, 300])
    np.testing.assert_array_equal(curves.values["outcome/reached"], [[0.25, np.nan]])
    np.testing.assert_array_equal(curves.values["learning_rate/defender"], [[2.0, 5.0]])


RUNS = {
    "one point": [record(0, 1, 3, 0.5)],
    "no fight ended": [record(0, 1, 0, None), record(0, 2, 0, None)],
    "several seeds, one shorter": [
        record(seed, i, 5, 0.1 * i) for seed in range(3) for i in range(1, 9 - seed)
    ],
    "keys missing": [{"steps": 10, "seed": 0}],
    "an agent that does not learn": [
        record(
            0, i, 2, 1.0, **{f"{key}/defender": None for key in ("kl", "learning_rate", "log_std")}
        )
        for i in (1, 2, 3)
    ],
    "rate of zero": [
        record(0, i, 2, 1.0, **{"kl/defender": 0.0, "kl/attacker": 0.0}) for i in (1, 2)
    ],
}


@pytest.mark.parametrize("name", RUNS)
@pytest.mark.long
def test_every_run_gives_a_picture(name: str, tmp_path: Path):
    path = tmp_path / "figures" / "learning.png"
    learning_curves(RUNS[name], path, name)
    with Image.open(path) as image:
        assert image.width > 1000
        assert np.asarray(image.convert("L")).std() > 5  # not blank
    assert path.with_suffix(".pdf").read_bytes().startswith(b"%PDF")
    assert sorted(file.name for file in path.parent.iterdir()) == ["learning.pdf", "learning.png"]


@pytest.mark.parametrize(
    "least, most", [(0.0072, 0.0095), (0.0055, 0.018), (0.002, 0.018), (0.005, 0.06), (0.005, 30.0)]
)
def test_logarithmic_axes_have_few_plain_numbers_and_their_label_beside_them(
    least: float, most: float, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    drawn: list[Figure] = []
    monkeypatch.setattr(figures, "save_figure", lambda figure, path: drawn.append(figure))
    rising = np.geomspace(least, most, 20)
    learning_curves(
        [record(0, i + 1, 5, 0.5, **{"kl/attacker": kl}) for i, kl in enumerate(rising)],
        tmp_path,
        "",
    )
    drawn[0].draw_without_rendering()
    (ax,) = (ax for ax in drawn[0].axes if ax.get_title().startswith("KL"))
    low, high = ax.get_ylim()
    shown = [text for text in ax.get_yticklabels() if low <= text.get_position()[1] <= high]
    assert 2 <= len(shown) <= 6 and all(float(text.get_text()) > 0 for text in shown)
    assert not any(text.get_text() for text in ax.get_yticklabels(minor=True))
    assert (
        0
        < min(text.get_window_extent().x0 for text in shown) - ax.yaxis.label.get_window_extent().x1
        < 10
    )


def test_faults_are_named_only_where_they_happened_and_older_records_lack_them():
    def named(records: list[dict[str, Any]]) -> set[str]:
        ax = Figure().add_subplot()
        figures.draw_outcomes(ax, gather(records))
        return {
            label
            for label in ax.get_legend_handles_labels()[1]
            if "invalid" in label or label == "diverged"
        }

    sound = [record(0, i, 4, 0.5) for i in (1, 2, 3)]
    assert named(sound) == set()
    older = [
        {key: value for key, value in row.items() if "invalid" not in key} for row in sound[:2]
    ]
    faulty = {"outcome/attacker_invalid": 0.25, "outcome/timeout": 0.25}
    assert named([*older, sound[2] | faulty]) == {"attacker's action invalid"}


def test_nothing_to_draw_and_nowhere_to_write(tmp_path: Path):
    with pytest.raises(UserError, match="no iteration") as raised:
        learning_curves([], tmp_path / "a.png", "empty")
    assert raised.value.exit_code == EXIT_DATA
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match="cannot write") as raised:
        learning_curves(RUNS["one point"], tmp_path / "file" / "a.png", "nowhere")
    assert raised.value.exit_code == EXIT_CANNOT_WRITE
