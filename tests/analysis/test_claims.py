"""The paper's claims on planted tournaments: true, false, undecidable; and the numbers by hand."""

import json

import numpy as np
import pytest
from planted_claims import METHODS, Truth, planted_claims
from tournaments import build, entrants

from dronecombat_jax.analysis import claim_measures as measures
from dronecombat_jax.analysis.claims import AGREES, DISAGREES, SMALLER, UNDECIDED, paper_claims
from dronecombat_jax.analysis.claims_text import COLUMNS, claims_json, claims_markdown
from dronecombat_jax.analysis.permutation import sign_flip_test
from dronecombat_jax.analysis.result import Alias
from dronecombat_jax.analysis.study import own_elo
from dronecombat_jax.files.plain import to_json
from dronecombat_jax.types import Cause

NAMES = [
    "attackers_ahead",
    "near_the_diagonal",
    "late_decline",
    "early_attackers",
    "final_gap",
    "varies_more",
]
TRUE = Truth(ahead=1.0, diagonal=1.0, decline=0.6, early=0.8, gap=0.8, spread=(0.02, 0.6))
FALSE = Truth(ahead=-1.0, diagonal=-1.0, decline=-0.6, early=-0.8, gap=-0.8, spread=(0.6, 0.02))


def decided(truth: Truth, **size) -> dict:
    result = planted_claims(truth, **size)
    return {claim.name: claim for claim in paper_claims(result, own_elo(result, 4), every=2)}


@pytest.fixture(scope="module")
def true() -> dict:
    return decided(TRUE._replace(early=1.6, spread=(0.02, 0.35)))


def test_claims_that_are_true_are_agreed_with(true):
    assert list(true) == NAMES
    assert {name: claim.verdict for name, claim in true.items()} == dict.fromkeys(NAMES, AGREES)
    assert all(claim.low > 0 for claim in true.values())


def test_claims_that_are_false_are_disagreed_with():
    claims = decided(FALSE._replace(early=-1.6, spread=(0.6, 0.02)))
    assert {name: claim.verdict for name, claim in claims.items()} == dict.fromkeys(
        NAMES, DISAGREES
    )
    assert all(claim.estimate < 0 for claim in claims.values())


def test_two_seeds_decide_nothing_and_the_note_says_so():
    result = planted_claims(TRUE, seeds=2)
    claims = paper_claims(result, own_elo(result, 2), every=2)
    assert {claim.verdict for claim in claims} == {UNDECIDED}
    text = claims_markdown(claims)
    assert "claims 1, 2, 3, 4, 5, 6 may stay undecided whatever the fights" in text


def test_a_gap_that_is_there_but_smaller_than_the_papers_is_called_so():
    """0.25 in log-odds are 43 Elo points."""
    claim = decided(Truth(gap=0.25), episodes=100)["final_gap"]
    assert claim.verdict == SMALLER and 20 < claim.estimate < 70 and claim.high < 100


def test_equal_methods_disagree_with_a_gap_of_100_and_decide_no_more():
    claims = decided(Truth(), episodes=100)
    assert claims["final_gap"].verdict == DISAGREES  # 100 points can be told from none
    for name in NAMES[:4] + NAMES[5:]:
        assert claims[name].verdict == UNDECIDED, name


def test_weaker_attackers_make_the_papers_gap_and_none_of_ours():
    """S-IPPO's attackers are 1.2 in log-odds, 208 Elo points, weaker; the defenders are equal."""
    claim = decided(Truth(weaker=1.2), episodes=100)["final_gap"]
    assert claim.by_protocol > 60 and abs(claim.estimate) < 20


def test_a_tournament_of_one_method_has_no_claims():
    sides = entrants("d", 2, 2), entrants("a", 2, 2)
    cause = np.full((4, 4, 2), Cause.TIMEOUT, np.int8)
    result = build(cause, *sides)
    assert paper_claims(result, own_elo(result, 2)) == ()


@pytest.mark.parametrize(
    ("measure", "truth"),
    [
        (measures.near_the_diagonal, Truth(ahead=1.0, improve=4.0)),  # far from additive rates
        (measures.late_decline, Truth(ahead=1.0, spread=(0.3, 0.3))),
    ],
)
@pytest.mark.long
def test_the_levels_hold_where_nothing_is_true(measure, truth):
    """Sign-flip tests of 60 worlds without the effect; at a level of 0.05."""
    worlds = [planted_claims(truth, 6, 6, 10, seed) for seed in range(60)]
    found = [sign_flip_test(measure(world, "ippo")).p_value < 0.05 for world in worlds]
    assert np.mean(found) < 0.14  # 0.05 and three standard errors


def test_each_number_by_hand():
    """One run of 10 chunks: the defender wins on the diagonal, loses elsewhere, but for two cells."""
    cause = np.full((10, 10, 4), Cause.REACHED, np.int8)
    for chunk in range(10):
        cause[chunk, chunk] = Cause.INTERCEPT
    cause[3, 0] = Cause.INTERCEPT
    cause[9, 1, :2] = Cause.INTERCEPT
    result = build(cause, entrants("d", 1, 10), entrants("a", 1, 10))
    # against attackers 1 to 6 (rows 4, 5, 6: 2, 1, 1 of 6; rows 7 to 10: 0, 0, 0, 1/2 of 6)
    np.testing.assert_allclose(measures.late_decline(result, "ippo"), [4 / 18 - 0.5 / 24])
    np.testing.assert_allclose(measures.own_past(result, "ippo"), [0.5 / 5])
    assert measures.near_the_diagonal(result, "ippo")[0] > 0.1
    elo = {"ippo#0": np.concatenate([np.full(10, 1400.0), np.full(10, 1600.0)])}
    np.testing.assert_allclose(measures.attackers_ahead(result, elo, "ippo"), [200.0])
    np.testing.assert_allclose(measures.final_own_elo(result, elo, "ippo"), [1400.0])


def test_the_distance_from_the_median_by_hand():
    """Win rates 0, 1/2 and 1 in the one cell: the median is 1/2."""
    cause = np.full((3, 3, 2), Cause.REACHED, np.int8)
    cause[1, 1, 0] = cause[2, 2, 0] = cause[2, 2, 1] = Cause.INTERCEPT
    result = build(cause, entrants("d", 3, 1), entrants("a", 3, 1))
    np.testing.assert_allclose(measures.distance_from_median(result, "ippo"), [0.5, 0.0, 0.5])


def test_a_policy_that_was_saved_again_counts_once_and_a_missing_cell_leaves_the_seed_out():
    defenders, attackers = entrants("d", 1, 2), entrants("a", 1, 2)
    first = defenders[0]._replace(also=(Alias(*defenders[0][1:7])._replace(chunk=2),))
    last = defenders[1]._replace(chunk=3)
    cause = np.full((2, 2, 1), Cause.REACHED, np.int8)
    (own,) = measures.own_maps(build(cause, [first, last], attackers), "ippo")
    np.testing.assert_allclose(own.defender_time, [1 / 3, 1])
    np.testing.assert_allclose(own.attacker_time, [1 / 2, 1])
    cause[0, 1] = Cause.NONE
    assert measures.own_maps(build(cause, [first, last], attackers), "ippo") == []


def test_the_table_has_all_columns_and_the_data_is_plain(true):
    claims = tuple(true.values())
    head, rule, *rows = claims_markdown(claims).split("\n\n")[0].splitlines()
    assert head == f"| {' | '.join(COLUMNS)} |" and set(rule) == set("|-")
    assert len(rows) == 6 and all(row.count(" | ") == 5 for row in rows)
    assert all(row.endswith("AGREES |") for row in rows) and rows[4].startswith(
        "| 5. S-IPPO's final"
    )
    told = json.loads(to_json(claims_json(claims)))
    assert [item["name"] for item in told] == NAMES
    assert [len(seeds) for seeds in told[4]["values"].values()] == [8, 8]
    assert list(told[4]["values"]) == list(METHODS)
