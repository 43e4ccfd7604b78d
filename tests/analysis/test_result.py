"""The tournament's result: counts, rates, what is refused."""

import numpy as np
import pytest
from tournaments import CONTROL_DT, WINNER, build, entrants, from_letters

from dronecombat_jax.analysis.result import (
    first_episodes,
    score_rate,
    scores,
    select,
    tournament_result,
    win_rate,
)
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.types import Cause

TABLE = from_letters([["wwd", "lll", "..."], ["wld", "ddd", "www"]])


def test_scores_and_rates_of_a_table_counted_by_hand():
    assert scores(TABLE).wins.tolist() == [[2, 0, 0], [1, 0, 3]]
    assert scores(TABLE).ties.tolist() == [[1, 0, 0], [1, 3, 0]]
    assert scores(TABLE).losses.tolist() == [[0, 3, 0], [1, 0, 0]]
    np.testing.assert_allclose(score_rate(TABLE), [[2.5 / 3, 0, np.nan], [0.5, 0.5, 1]])
    np.testing.assert_allclose(win_rate(TABLE), [[2 / 3, 0, np.nan], [1 / 3, 0, 1]])


def test_a_missing_cell_is_flagged_and_not_counted():
    assert TABLE.played.tolist() == [[True, True, False], [True, True, True]]
    assert TABLE.counts[0, 2].sum() == 0
    assert TABLE.counts.sum() == 15


def test_every_cause_is_won_by_whom_the_rules_say():
    cause = np.arange(1, len(Cause), dtype=np.int8)[:, None, None]
    result = build(cause)
    expected = [{0: 1.0, 1: 0.5, 2: 0.0}[WINNER[one]] for one in range(1, len(Cause))]
    assert score_rate(result)[:, 0].tolist() == expected


def test_select_and_first_episodes_keep_cells_together():
    part = first_episodes(select(TABLE, np.array([1]), np.array([2, 0])), 2)
    assert scores(part).wins.tolist() == [[2, 1]]
    assert scores(part).losses.tolist() == [[0, 1]]
    assert [entrant.chunk for entrant in part.attackers] == [3, 1]


def test_a_result_from_before_the_last_causes_is_read():
    old = tournament_result(
        TABLE.cause, TABLE.steps, WINNER[:8], TABLE.defenders, TABLE.attackers, CONTROL_DT
    )
    assert old.counts.tolist() == TABLE.counts.tolist()


def broken(**change):
    fields = {
        "cause": TABLE.cause,
        "steps": TABLE.steps,
        "winner": WINNER,
        "defenders": TABLE.defenders,
        "attackers": TABLE.attackers,
        "control_dt": CONTROL_DT,
    }
    return {**fields, **change}


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"steps": TABLE.steps[:, :, :2]}, "durations"),
        ({"defenders": entrants("d", 1, 3)}, "causes"),
        ({"cause": TABLE.cause.astype(float)}, "integers"),
        ({"winner": WINNER[:4]}, "causes"),
        ({"winner": ()}, "winners"),
        ({"cause": TABLE.cause - 1}, "causes -1"),
        ({"played": np.ones((2, 3), bool)}, "played cell"),
        ({"played": np.zeros((2, 3), bool)}, "missing one"),
        ({"played": np.ones((3, 2), bool)}, "`played`"),
        ({"steps": np.ones_like(TABLE.steps)}, "control step"),
        ({"attackers": [TABLE.attackers[0]] * 3}, "twice"),
    ],
)
def test_contradictions_are_refused_as_bad_data(change, reason):
    with pytest.raises(UserError, match=reason) as caught:
        tournament_result(**broken(**change))
    assert caught.value.exit_code == EXIT_DATA
