"""alpha-Rank against OpenSpiel's (golden file; `tests/golden/make_alpha_rank_golden.py`)."""

import json
from pathlib import Path

import numpy as np
import pytest

from dronecombat_jax.analysis.alpha_rank import alpha_rank

GOLDEN = json.loads((Path(__file__).parents[1] / "golden" / "alpha_rank.json").read_text())


@pytest.mark.parametrize("case", GOLDEN["cases"], ids=lambda case: f"alpha {case['alpha']}")
def test_the_stationary_distribution_is_openspiels(case):
    rank = alpha_rank(np.asarray(GOLDEN["scores"]), case["alpha"], case["population"])
    np.testing.assert_allclose(rank.profile, case["profile"], atol=1e-10)
    assert rank.residual < 1e-12


def test_the_distribution_is_whole_and_its_marginals_are_its_sums():
    rank = alpha_rank(np.asarray(GOLDEN["scores"]))
    assert rank.profile.sum() == pytest.approx(1)
    np.testing.assert_allclose(rank.defender, rank.profile.sum(axis=1))
    np.testing.assert_allclose(rank.attacker, rank.profile.sum(axis=0))


def test_one_profile_and_a_hole():
    assert alpha_rank(np.array([[0.2]])).profile.tolist() == [[1.0]]
    with pytest.raises(ValueError, match="every cell"):
        alpha_rank(np.array([[0.2, np.nan]]))
