"""When skill counts as there."""

import math

import pytest

from benchmarks.time_to_skill import Arrival, reached


@pytest.mark.parametrize(
    ("hits", "sustained", "expected"),
    [
        ([0.1, 0.96, 0.97, 0.98], 3, 1),
        ([0.96, 0.97, 0.5, 0.96, 0.95], 2, 0),
        ([0.96, 0.5, 0.96, 0.95], 2, 2),  # a dip begins the row anew
        ([0.96, math.nan, 0.96, 0.96], 2, 2),  # no fight ended: nothing is known
        ([0.94, 0.949], 1, None),
        ([0.96, 0.96], 3, None),  # not yet long enough
    ],
)
def test_skill_is_there_where_a_long_enough_row_begins(hits, sustained, expected):
    arrivals = [Arrival(steps, share, float(steps)) for steps, share in enumerate(hits)]
    found = reached(arrivals, 0.95, sustained)
    assert (None if found is None else found.steps) == expected
