"""The curves of a study: what is kept is what is drawn."""

import sys
from pathlib import Path

import curves
import measured
import numpy as np
import pytest
import variants
from kept import Kept

STUDY = """
preset = "smoke"
steps = 9_000
seeds = [3, 4]
[variants.plain]
about = "as `it` is"
[variants.other]
"""


def run(*intercepted: float | None) -> dict:
    return {
        "curve": [{**dict.fromkeys(measured.NAMES, 0.1), "intercepted": x} for x in intercepted]
    }


@pytest.fixture
def study(tmp_path) -> Path:
    """A study of which two seeds of one variant are kept."""
    path = tmp_path / "mine.toml"
    path.write_text(STUDY)
    (plain, _), kept = variants.read_study(path).variants, Kept(path)
    kept.keep("plain", 3, plain.changed, run(None, 0.2, 0.6))
    kept.keep("plain", 4, plain.changed, run(0.0, 0.4))
    return path


def test_a_panel_has_each_seed_and_their_mean(study):
    ((title, runs),) = curves.panels(variants.read_study(study), Kept(study))
    assert title == "plain: as it is" and len(runs) == 2
    (ax,) = curves.draw([(title, runs)]).axes
    drawn = [line for line in ax.lines if line.get_color() == curves.LINES["intercepted"][0]]
    solid = [line for line in drawn if line.get_linestyle() == "-"]
    np.testing.assert_allclose(np.asarray(solid[0].get_ydata()), [np.nan, 0.2, 0.6])
    np.testing.assert_allclose(np.asarray(solid[1].get_ydata()), [0.0, 0.4])
    np.testing.assert_allclose(
        np.asarray(solid[2].get_ydata()), [np.nan, 0.3]
    )  # as long as the shorter one
    np.testing.assert_allclose(np.asarray(solid[0].get_xdata()), [0.5, 1.5, 2.5])


def test_the_command_draws_and_says_where_there_is_nothing(study, monkeypatch, capsys):
    out = study.with_name("curves.png")
    monkeypatch.setattr(sys, "argv", ["curves.py", str(study), "--out", str(out)])
    assert curves.main() == 0 and out.stat().st_size > 1000
    monkeypatch.setattr(sys, "argv", [*sys.argv, "--only", "other"])
    assert curves.main() == 1
    assert capsys.readouterr().err == f"{study}: nothing is kept of it\n"
