"""Whole parts of tournaments with holes."""

import numpy as np
from tournaments import build, from_letters

from dronecombat_jax.analysis.design import complete_part
from dronecombat_jax.types import Cause


def test_a_missing_seed_costs_its_row_only():
    part = complete_part(from_letters([["w", "l"], [".", "."], ["d", "w"]]))
    assert [entrant.chunk for entrant in part.defenders] == [1, 3]
    assert len(part.attackers) == 2
    assert part.played.all()


def test_one_missing_cell_costs_one_attacker_whatever_the_order():
    cause = np.ones((3, 3, 1), np.int8)
    cause[1, 2] = Cause.NONE
    result = build(cause)
    kept = complete_part(result)
    assert [entrant.chunk for entrant in kept.attackers] == [1, 2]
    assert len(kept.defenders) == 3
    backwards = build(cause[::-1, ::-1], result.defenders[::-1], result.attackers[::-1])
    assert {one.identity for one in complete_part(backwards).attackers} == {
        one.identity for one in kept.attackers
    }


def test_nothing_played_leaves_nothing():
    assert complete_part(from_letters([[".", "."]])).played.size == 0
