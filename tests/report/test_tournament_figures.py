"""Every figure of a tournament draws, says what it rests on, and shows degenerate results without
inventing any.
"""

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from planted import planted
from tournaments import build, entrants, from_letters

from dronecombat_jax.analysis.map_tests import shown_defenders
from dronecombat_jax.analysis.result import SCRIPTED, Alias, Entrant, TournamentResult, select
from dronecombat_jax.analysis.study import Effort, study
from dronecombat_jax.report.map_figures import variance_map, win_rate_map
from dronecombat_jax.report.sheet import MISSING, common, mean_and_spread, name, timelines_of
from dronecombat_jax.report.tournament_report import FIGURES
from dronecombat_jax.types import Cause

QUICK = Effort(orders=2, bootstrap=10, value_samples=2)


def without(result: TournamentResult, lineage: str) -> TournamentResult:
    """The same with no fight of one seed's defenders."""
    gone = [index for index, one in enumerate(result.defenders) if one.lineage == lineage]
    cause = result.cause.copy()
    cause[gone] = Cause.NONE
    return build(cause, result.defenders, result.attackers)


def pilots_only() -> TournamentResult:
    pilots = [Entrant(f"pilot-{i}", f"pilot {i}", SCRIPTED, "", -1, -1, 0) for i in range(2)]
    return build(np.full((2, 2, 3), Cause.REACHED, np.int8), pilots, pilots)


def hostile() -> TournamentResult:
    bad = ["$x$_{", "a\nb<script>", "=1+1", "ü" * 300, "</style>&"]
    side = [
        one._replace(label=bad[i % 5], method=bad[i % 2])
        for i, one in enumerate(entrants("d", 1, 5))
    ]
    return build(np.full((5, 5, 2), Cause.TIMEOUT, np.int8), side, side)


DEGENERATE = {  # name: the result, and what must be said to be missing
    "unbeaten attacker": (
        from_letters([["lll", "wld"], ["lll", "dww"]]),
        "1 of 4 ratings are open",
    ),
    "only ties": (from_letters([["ddd", "ddd"], ["ddd", "ddd"]]), "found no optimum"),
    "one fight": (from_letters([["w"]]), "2 of 2 ratings are open"),
    "missing cell": (
        from_letters([["wld", "..."], ["lwl", "dwl"]]),
        "1 of 4 cells were not played",
    ),
    "groups that never met": (
        from_letters([["wl", ".."], ["..", "dd"]]),
        "2 groups that never met",
    ),
    "nobody fought": (from_letters([["..", ".."]]), "no fight as defender"),
    "5 of 6 seeds": (without(planted(3, 2, 4), "s-ippo#1"), "s-ippo#1: no defenders fought"),
    "scripted pilots": (pilots_only(), "ratings are open"),
    "hostile names": (hostile(), "found no optimum"),
}


def texts(figure: Figure) -> str:
    return " ".join(str(text.get_text()) for text in figure.findobj(Text)).replace("\n", " ")


@pytest.mark.parametrize("case", DEGENERATE)
@pytest.mark.long
def test_degenerate_results_are_drawn_and_what_is_missing_is_said(case):
    result, gap = DEGENERATE[case]
    told = study(result, QUICK)
    assert gap in " ".join(told.missing)
    for heading, draw, _ in FIGURES.values():
        figure = draw(told)
        figure.draw_without_rendering()
        assert "fights (" in texts(figure), heading


@pytest.fixture(scope="module")
def sound():
    return study(planted(3, 4, 6), QUICK)


def test_a_sound_tournament_lacks_nothing(sound):
    assert sound.missing == ()
    assert sound.methods == ("ippo", "s-ippo")


@pytest.mark.parametrize("file", FIGURES)
def test_every_figure_names_its_axes_its_fights_and_its_seeds(file, sound):
    figure = FIGURES[file][1](sound)
    told = texts(figure)
    assert "Training seeds: ippo 3, s-ippo 3" in told
    assert "no run" not in told and "took part" not in told
    if "Elo points" in told:
        assert "Gauge: the mean over all entrants of both roles is 1500" in told
    panels = [ax for ax in figure.axes if ax.get_visible() and ax.get_label() != "<colorbar>"]
    assert all(
        ax.get_xlabel() or any(text.get_text() for text in ax.get_xticklabels()) for ax in panels
    )
    assert all(
        panels[0].get_shared_y_axes().joined(ax, panels[0])
        or ax.get_ylabel()
        or ax.get_yticks().size
        for ax in panels
    )
    assert any(ax.get_ylabel() for ax in panels) or file == "finals"


def test_a_cell_without_fights_is_grey_and_its_variance_of_one_seed_too():
    result = planted(2, 3, 4)
    cause = result.cause.copy()
    cause[0, 0] = Cause.NONE  # ippo's seed 0, first chunk against first
    told = study(build(cause, result.defenders, result.attackers), QUICK)
    for draw, masked in ((win_rate_map, 0), (variance_map, 1)):
        ax = draw(told).axes[0]
        assert ax.get_facecolor() == pytest.approx([int(MISSING[1:3], 16) / 255] * 3 + [1.0])
        assert np.ma.count_masked(ax.images[0].get_array()) == masked


def test_ten_defenders_are_shown_with_the_first_and_the_last():
    assert shown_defenders(100).tolist() == [0, 11, 22, 33, 44, 55, 66, 77, 88, 99]
    assert shown_defenders(3).tolist() == [0, 1, 2]


def test_own_elo_rates_each_run_by_itself(sound):
    """Conserved within a run: the mean over its entrants of both roles is the start."""
    lineages = np.asarray([one.lineage for one in sound.entrants])
    assert set(sound.own_elo) == set(lineages) - {""}
    for lineage, elo in sound.own_elo.items():
        assert elo[lineages == lineage].mean() == pytest.approx(1500)
        assert np.isnan(elo[lineages != lineage]).all()


def test_a_policy_saved_again_has_its_value_at_every_time():
    side = [one._replace(steps=one.chunk * 10) for one in entrants("d", 2, 2)]
    side[0] = side[0]._replace(
        chunk=2,
        steps=20,
        also=(Alias("", "ippo", "ippo", 0, 1, 10), Alias("", "other", "copy", 5, 4, 40)),
    )
    side[1] = side[1]._replace(chunk=3, steps=30)
    lines = timelines_of(side, np.arange(4.0), ["ippo", "other"])
    np.testing.assert_array_equal(lines["ippo"].values, [[0, 0, 1], [2, 3, np.nan]])
    assert lines["ippo"].steps.tolist() == [10, 20, 30]
    assert lines["other"].lineages == ("copy#5",) and lines["other"].values.tolist() == [[0]]
    own = timelines_of(side, {"ippo#0": np.array([5.0, 6, 7, 8])}, ["ippo"])["ippo"]
    np.testing.assert_array_equal(own.values, [[5, 5, 6], [np.nan] * 3])


def test_a_report_does_not_depend_on_how_the_entrants_are_listed():
    result = planted(2, 3, 4)
    rng = np.random.default_rng(0)
    order = [rng.permutation(size) for size in result.played.shape]
    one, other = study(result, QUICK), study(select(result, *order), QUICK)
    assert one.cyclic.keys() == other.cyclic.keys()
    for first, second in zip(one.cyclic.values(), other.cyclic.values(), strict=True):
        assert first and second and first.p_value == second.p_value
        assert first.corrected == pytest.approx(second.corrected, abs=1e-9)
    places = [*order[0], *(len(order[0]) + order[1])]
    np.testing.assert_allclose(other.scale.rating, one.scale.rating[places], atol=1e-8)
    np.testing.assert_array_equal(other.elo_scale.rating, one.elo_scale.rating[places])
    for lineage, elo in one.own_elo.items():
        np.testing.assert_array_equal(other.own_elo[lineage], elo[places])
    assert one.populations.keys() == other.populations.keys()
    for method, value in one.populations.items():
        assert value[:3] == pytest.approx(other.populations[method][:3], abs=1e-9)


def test_time_lines_align_seeds_by_steps_and_leave_gaps():
    # seed 1 lacks its third chunk
    side = [one._replace(steps=one.chunk * 10) for one in entrants("d", 2, 3)][:5]
    line = timelines_of(side, np.arange(5.0), ["ippo"])["ippo"]
    assert line.lineages == ("ippo#0", "ippo#1") and line.steps.tolist() == [10, 20, 30]
    np.testing.assert_array_equal(line.values, [[0, 1, 2], [3, 4, np.nan]])
    mean, spread, count = mean_and_spread(line.values)
    np.testing.assert_allclose(mean, [1.5, 2.5, 2.0])
    np.testing.assert_allclose(spread, [1.5 * np.sqrt(2), 1.5 * np.sqrt(2), np.nan])
    assert count.tolist() == [2, 2, 1]


def test_names_stay_on_one_line_and_begin_no_formula():
    assert name("a\n$b$") == r"a?\$b\$"
    assert len(name("x" * 300)) == 32


def test_a_mean_over_seeds_is_drawn_only_where_all_have_a_checkpoint():
    # the third never fought
    values = np.asarray([[1.0, 2.0, np.nan, 4.0], [1.0, np.nan, 3.0, 4.0], [np.nan] * 4])
    assert common(values).tolist() == [True, False, False, True]
    assert not common(np.full((2, 3), np.nan)).any()
