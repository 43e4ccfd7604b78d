"""Forgetting, maps over runs, home and away."""

import numpy as np
import pytest
from tournaments import build, entrants, from_letters

from dronecombat_jax.analysis.forgetting import (
    RunMap,
    forgetting,
    home_and_away,
    run_maps,
    summarise_maps,
)
from dronecombat_jax.analysis.result import Alias
from dronecombat_jax.types import Cause

NAN = np.nan
#           attacker 0    1    2
SCORE = np.array([[0.5, 0.1, 0.0], [0.7, 0.6, 0.2], [0.3, 0.9, 0.8]])


def test_a_run_summarised_by_hand():
    told = forgetting(SCORE)
    assert told.lag.tolist() == [-2, -1, 0, 1, 2]
    # Lag 1: the defenders 1, 2 against the attackers 0, 1: 0.7 and 0.9. Lag -1, the future: 0.1 and
    # 0.2.
    np.testing.assert_allclose(told.profile, [0.0, 0.15, 1.9 / 3, 0.8, 0.3])
    assert told.pairs.tolist() == [1, 2, 3, 2, 1]
    # The last one against attackers 0, 1 less what each had at the time: (0.3 - 0.5 + 0.9 - 0.6) /
    # 2.
    assert told.backward_transfer == pytest.approx(0.05)
    np.testing.assert_allclose(told.worst_past, [0.5, 0.6, 0.3])
    assert told.final_worst == 0.3


def test_missing_cells_are_left_out():
    holed = SCORE.copy()
    holed[2, 1] = holed[0, 2] = holed[0, 0] = NAN
    told = forgetting(holed)
    np.testing.assert_allclose(told.profile, [NAN, 0.15, 0.7, 0.7, 0.3])
    assert told.pairs.tolist() == [0, 2, 2, 1, 1]
    assert np.isnan(told.backward_transfer)  # neither past attacker has both numbers
    np.testing.assert_allclose(told.worst_past, [NAN, 0.6, 0.3])
    assert np.isnan(forgetting(np.array([[0.4]])).backward_transfer)
    with pytest.raises(ValueError, match="square"):
        forgetting(SCORE[:2])


def test_each_run_is_mapped_on_the_common_chunks_whatever_the_order_of_entrants():
    defenders = [*entrants("d", 1, 2), *entrants("d", 1, 3, ("s-ippo",))]
    attackers = [*entrants("a", 1, 3, ("s-ippo",)), *entrants("a", 1, 2)]
    cause = np.full((5, 5, 2), Cause.REACHED, np.int8)
    cause[1, 3] = Cause.INTERCEPT  # ippo's second defender beats its first attacker
    cause[4, 0] = Cause.TIMEOUT  # s-ippo's third ties with its first
    order = np.array([4, 0, 3, 1, 2])
    result = build(cause[order], [defenders[one] for one in order], attackers)
    maps = {one.run: one for one in run_maps(result)}
    np.testing.assert_allclose(maps["ippo#0"].score, [[0, 0, NAN], [1, 0, NAN], [NAN] * 3])
    np.testing.assert_allclose(maps["s-ippo#0"].score, [[0, 0, 0], [0, 0, 0], [0.5, 0, 0]])
    assert maps["ippo#0"].chunks.tolist() == [1, 2, 3]
    assert (maps["s-ippo#0"].method, maps["s-ippo#0"].seed) == ("s-ippo", 0)


def test_means_and_variances_are_of_the_runs_that_played():
    chunks = np.array([1])
    cells = [RunMap("", "", 0, chunks, np.array([[value]])) for value in (0.2, NAN, 0.6)]
    told = summarise_maps(cells)
    assert (told.mean[0, 0], told.variance[0, 0], told.runs[0, 0]) == pytest.approx((0.4, 0.08, 2))
    alone = summarise_maps(cells[:2])
    assert alone.runs[0, 0] == 1 and np.isnan(alone.variance[0, 0])
    assert np.isnan(summarise_maps(cells[1:2]).mean[0, 0])


def test_a_policy_that_a_chunk_left_alone_stands_at_every_chunk():
    """Saved after chunks 1, 2 and 4, learnt in 3: the map has four rows, the first two the same."""
    first, second = entrants("d", 1, 2)
    again = Alias("ippo 0", "ippo", "ippo", 0, 2, 2000)
    defenders = [
        first._replace(also=(again,)),
        second._replace(chunk=3, also=(again._replace(chunk=4),)),
    ]
    result = from_letters([["w", "l"], ["d", "w"]])._replace(defenders=tuple(defenders))
    (told,) = run_maps(result)
    assert told.chunks.tolist() == [1, 2, 3, 4]
    np.testing.assert_allclose(told.score[:, :2], [[1, 0], [1, 0], [0.5, 1], [0.5, 1]])
    assert np.isnan(told.score[:, 2:]).all()  # the attackers have two chunks


def test_home_and_away_by_hand():
    # Attackers: own run (w, l), another (d, d), a third (l, unplayed), a scripted pilot that counts
    # for neither.
    attackers = [*entrants("a", 3, 2), *entrants("a", 0, 0, scripted=1)]
    result = from_letters([["w", "l", "d", "d", "l", ".", "w"]])._replace(
        attackers=tuple(attackers)
    )
    assert home_and_away(result, "ippo#0") == pytest.approx((0.5, 0.25))
