"""The answer to "which method's defender is better" in words, and as data."""

import json

import numpy as np
import pytest
from planted import planted
from scipy.special import expit
from tournaments import build, entrants, from_rates

from dronecombat_jax.analysis.permutation import smallest_p
from dronecombat_jax.analysis.result import Alias, select
from dronecombat_jax.analysis.verdict import judge
from dronecombat_jax.analysis.verdict_text import verdict_json, verdict_text
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.files.plain import to_json
from dronecombat_jax.tournaments.comparison import write_comparison
from dronecombat_jax.tournaments.grouping import as_compared, regroup
from dronecombat_jax.types import Cause

METHODS = ("ippo", "s-ippo")


def finals(
    gap: float,
    seeds: int = 6,
    spread: float = 0.15,
    episodes: int = 200,
    methods: tuple[str, ...] = METHODS,
    pilots: int = 0,
):
    """Final policies and pilots; the last method's defenders are `gap` better, in log-odds."""
    rng = np.random.default_rng(1)
    sides = entrants("d", seeds, 1, methods), entrants("a", seeds, 1, methods, pilots)
    lift = np.asarray([rng.normal(gap * (one.method == methods[-1]), spread) for one in sides[0]])
    return from_rates(
        expit(lift[:, None] + np.zeros(len(sides[1]))),
        episodes,
        0,
        defenders=sides[0],
        attackers=sides[1],
    )


def test_a_clear_difference_is_a_yes_with_the_winner_first():
    (answer,) = judge(finals(1.0)).answers
    assert answer.sentence.startswith("YES: s-ippo's final defender beats ippo's.")
    assert (
        "6 v 6 training seeds" in answer.sentence
        and "exact permutation p = 0.0022" in answer.sentence
    )
    assert answer.means[1] > answer.means[0]


def test_unequal_attackers_do_not_make_equal_defenders_differ():
    """0.6 against one method's attackers, 0.3 against the other's: YES by plain means."""
    sides = entrants("d", 8, 1, METHODS), entrants("a", 8, 1, METHODS)
    share = np.broadcast_to(np.repeat([0.6, 0.3], 8)[:, None], (16, 16, 1))
    won = np.arange(50) < 50 * share - 1e-9
    cause = np.where(won, Cause.INTERCEPT, Cause.REACHED).astype(np.int8)
    verdict = judge(build(cause, *sides))
    (answer,) = verdict.answers
    assert answer.sentence.startswith("NO DIFFERENCE OF 25 ELO") and answer.means == (0.45, 0.45)
    assert answer.numbers.p_value == 1 and all(one.p_value == 1 for one in answer.secondary)
    text = verdict_text(verdict)
    assert "adjusted score        ippo 0.450   s-ippo 0.450" in text
    assert "plain mean            -0.020 [-0.020, -0.020] for information" in text
    told = verdict_json(verdict)
    assert told["comparisons"][0]["mean_adjusted_score"] == {"ippo": 0.45, "s-ippo": 0.45}
    assert {(seed["adjusted_score"], round(seed["plain_score"], 9)) for seed in told["seeds"]} == {
        (0.45, 0.44),
        (0.45, 0.46),
    }


def test_equality_must_be_shown_and_is_not_the_same_as_no_difference():
    (equal,) = judge(finals(0.0, spread=0.01, episodes=400)).answers
    assert equal.sentence.startswith("NO DIFFERENCE OF 25 ELO")
    (open_,) = judge(finals(0.0, spread=0.6)).answers
    assert (
        open_.sentence.startswith("UNDECIDED")
        and "not evidence that they are equal" in open_.sentence
    )
    assert "no result could have been significant" not in open_.sentence


def test_too_few_seeds_are_said_to_be_too_few():
    (answer,) = judge(finals(3.0, seeds=3)).answers
    assert answer.sentence.startswith("UNDECIDED")
    assert (
        "With 3 v 3 training seeds no result could have been significant: the smallest possible p is 0.1"
        in answer.sentence
    )
    assert smallest_p(4, 4) == pytest.approx(2 / 70) and smallest_p(3, 4) == pytest.approx(1 / 35)


def test_all_pairs_are_judged_together_and_the_text_names_holm():
    verdict = judge(finals(2.0, methods=("a", "b", "c")))
    assert [(one.numbers.first, one.numbers.second) for one in verdict.answers] == [
        ("a", "b"),
        ("a", "c"),
        ("b", "c"),
    ]
    assert "after Holm" in verdict.answers[1].sentence
    assert verdict_text(verdict).count("  permutation p ") == 3


def test_secondary_questions_are_asked_where_the_tournament_can_answer():
    (few,) = judge(finals(0.5)).answers
    assert {one.measure for one in few.secondary} >= {"spread of the score over seeds"}
    (more,) = judge(planted(3, 4, 4)).answers
    assert [one.measure for one in more.secondary][:2] == [
        "backward transfer",
        "worst case against the own past, adjusted",
    ]
    assert all(one.adjusted_p >= one.p_value for one in more.secondary)


def test_the_data_are_plain_json():
    told = json.loads(to_json(verdict_json(judge(finals(1.0, seeds=1, pilots=1)))))
    (one,) = told["comparisons"]
    assert one["adjusted_score"]["low"] is None and one["p_value"] == 1.0 and one["seeds"] == [1, 1]
    assert [seed["run"] for seed in told["seeds"]] == ["ippo#0", "s-ippo#0"]


def test_what_cannot_be_compared_is_refused_in_one_line():
    with pytest.raises(UserError, match="all final defenders are of ippo") as raised:
        judge(finals(0.0, methods=("ippo",)))
    assert raised.value.exit_code == EXIT_DATA
    with pytest.raises(UserError, match="no final defender of nobody"):
        judge(finals(0.0), ["ippo", "nobody"])
    unplayed = build(
        np.full((2, 2, 1), Cause.NONE, np.int8),
        entrants("d", 1, 1, METHODS),
        entrants("a", 1, 1, METHODS),
    )
    with pytest.raises(UserError, match="nothing to compare"):
        judge(unplayed)
    with pytest.raises(UserError, match="no attacker met the final defenders of two runs"):
        judge(finals(1.0, seeds=1))  # each has met the other's attacker alone, weak or not
    # the first meets its own attacker only
    own = select(finals(0.0, seeds=1), np.asarray([0, 1]), np.asarray([0]))
    with pytest.raises(UserError, match="nothing to compare"):
        judge(own)


def test_runs_are_grouped_anew_and_the_answer_is_written(tmp_path):
    result = finals(1.0)
    text = write_comparison(
        regroup(result, {"ippo": "without", "s-ippo": "with"}), tmp_path, "method", notes=["a note"]
    )
    assert text.startswith("YES: with's final defender beats without's.") and text.endswith(
        "note: a note"
    )
    assert (tmp_path / "comparison.txt").read_text() == text + "\n"
    assert json.loads((tmp_path / "comparison.json").read_text())["by"] == "method"
    with pytest.raises(UserError, match="not given: s-ippo"):
        regroup(result, {"ippo": "x"})
    about = {"by": "run", "methods": {"ippo": "without", "s-ippo": "with"}, "panel_every": 3}
    again, told = as_compared(result, about)
    assert again.defenders == regroup(result, about["methods"]).defenders
    assert told == ("run", 3) and as_compared(result, {}) == (result, ("method", 10))


def test_a_policy_saved_in_two_runs_is_grouped_under_all_its_names():
    result = finals(0.0)
    first = result.defenders[0]
    result = result._replace(
        defenders=(
            first._replace(also=(Alias(*first[1:7])._replace(run="s-ippo"),)),
            *result.defenders[1:],
        )
    )
    again = regroup(result, {"ippo": "x", "s-ippo": "y"}).defenders[0]
    assert again.method == "x" and again.also[0].method == "y"
