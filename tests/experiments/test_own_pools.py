"""What the paper shows, in each run of a study: what is counted of its own tournament, and the table."""

import sys

import numpy as np
import own_pools
import pytest
import variants
from kept import Kept
from tournaments import build, entrants

from dronecombat_jax.types import Cause

STUDY = """
preset = "duel"
steps = 960
seeds = [0, 1]
[variants.default]
about = "as it is"
[variants.later]
on = "default"
"""


def planted(middle, late):
    """A run of ten checkpoints: its defenders win `middle` of five fights up to 0.6 of the training,
    and `late` after that.
    """
    cause = np.full((10, 10, 5), Cause.REACHED, np.int8)
    for row in range(10):
        cause[row, :, : late if row + 1 > 6 else middle] = Cause.INTERCEPT
    return build(cause, defenders=entrants("d", 1, 10), attackers=entrants("a", 1, 10))


@pytest.mark.parametrize(
    ("middle", "late", "shown"), [(2, 1, (True, True, True)), (4, 4, (False, False, False))]
)
def test_a_run_shows_what_is_planted(middle, late, shown):
    counted = own_pools.counted(planted(middle, late))
    assert counted["win_rate"] == pytest.approx((0.6 * middle + 0.4 * late) / 5)
    assert counted["decline"] == pytest.approx((middle - late) / 5)
    assert (counted["attackers_ahead"] > 50.0) == shown[0]
    assert own_pools.shows(counted) == shown


def test_a_row_has_a_variants_seeds_and_what_is_not_flown_is_said(tmp_path, monkeypatch, capsys):
    path = tmp_path / "small.toml"
    path.write_text(STUDY)
    default, later = variants.read_study(path).variants
    kept = Kept(path, "own")
    for seed, ahead in enumerate((90.0, -10.0)):
        numbers = {"attackers_ahead": ahead, "win_rate": 0.3, "decline": 0.0}
        kept.keep("default", seed, default.changed, numbers)
        # of other settings than today's: does not count
        kept.keep("later", seed, {**later.changed, "game.intercept_radius": 0.1}, numbers)
    assert kept.path == path.with_name("small_own.jsonl")
    monkeypatch.setattr(sys, "argv", ["own_pools.py", str(path), "--table"])
    assert own_pools.main() == 0
    table = capsys.readouterr().out
    assert "| `default`: as it is | 2 | 90, -10 | 0.30, 0.30 | 0.00, 0.00 | 2, 1 |" in table
    assert "| `later` | not flown |" in table
    # without --table, runs that are not there are not flown either, and what is kept stays
    monkeypatch.setattr(sys, "argv", ["own_pools.py", str(path), "--runs", str(tmp_path)])
    assert own_pools.main() == 0 and capsys.readouterr().out == table
