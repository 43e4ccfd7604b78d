"""What two pools rated apart can tell, on planted tournaments of equal defenders."""

from itertools import combinations

import numpy as np
import pytest
from planted_claims import Truth, planted_claims
from tournaments import build, entrants

from dronecombat_jax.analysis.claims import IPPO, SIPPO
from dronecombat_jax.analysis.protocol import Protocol, paper_protocol, protocol_json
from dronecombat_jax.analysis.study import own_elo
from dronecombat_jax.files.plain import to_json
from dronecombat_jax.report.protocol_figure import protocol_figure
from dronecombat_jax.types import Cause

WEAKER = 1.2  # log-odds, 208 points


def examined(truth: Truth, seeds: int = 4) -> Protocol:
    result = planted_claims(truth, seeds, 10, 20)
    protocol = paper_protocol(result, own_elo(result, 4), every=2)
    assert protocol is not None
    return protocol


@pytest.fixture(scope="module")
def weaker() -> Protocol:
    return examined(Truth(weaker=WEAKER))


def test_weaker_attackers_alone_make_a_difference_of_half_their_weakness(weaker):
    """A pool's mean is fixed: 208 points off every attacker are 104 on every defender, where Elo
    has converged, which 50 fights a player do not quite reach.
    """
    assert 50 < weaker.difference < 120
    assert weaker.by_attackers == pytest.approx(weaker.difference, abs=40)
    assert weaker.p_value == pytest.approx(
        2 / 70
    )  # the attackers are told apart, not the defenders


def test_equal_attackers_make_none():
    protocol = examined(Truth())
    assert abs(protocol.difference) < 40 and abs(protocol.by_attackers) < 30


def test_the_planted_weakening_lifts_from_nothing_and_monotonously(weaker):
    assert weaker.lifted.shape == (4, len(weaker.weaker)) and weaker.weaker[0] == 0
    np.testing.assert_array_equal(weaker.lifted[:, 0], 0)
    mean = weaker.lifted.mean(axis=0)
    assert (np.diff(mean) > 0).all()
    at = list(weaker.weaker).index(200.0)
    assert 60 < mean[at] < 115


def test_chance_is_every_relabelling(weaker):
    """A loop over all choices of four of eight numbers."""
    values = [*weaker.own[SIPPO], *weaker.own[IPPO]]
    expected = []
    for chosen in combinations(range(8), 4):
        rest = [values[i] for i in range(8) if i not in chosen]
        expected.append(np.mean([values[i] for i in chosen]) - np.mean(rest))
    np.testing.assert_allclose(np.sort(weaker.by_chance), np.sort(expected))
    assert weaker.by_chance[0] == weaker.difference == pytest.approx(expected[0])


def test_pools_that_were_not_flown_stay_unknown(weaker):
    assert np.isfinite(weaker.pools).all() and weaker.methods == (IPPO,) * 4 + (SIPPO,) * 4
    result = planted_claims(Truth(), 2, 4, 4)
    cause = np.array(result.cause)
    cause[3, 7] = Cause.NONE  # the final defender of the first run, the last attacker of the second
    part = build(cause, result.defenders, result.attackers)
    protocol = paper_protocol(part, own_elo(part, 2), every=2)
    assert protocol is not None
    assert np.argwhere(np.isnan(protocol.pools)).tolist() == [[0, 1]]
    assert "NaN" not in to_json(protocol_json(protocol))


def test_one_method_has_nothing_to_examine():
    cause = np.full((2, 2, 1), Cause.TIMEOUT, np.int8)
    result = build(cause, entrants("d", 2, 1), entrants("a", 2, 1))
    assert paper_protocol(result, own_elo(result, 2)) is None


def test_the_figure_has_three_panels_with_what_each_shows(weaker):
    figure = protocol_figure(weaker)
    titles = [ax.get_title() for ax in figure.axes]
    assert titles[0].startswith("By chance") and "planted" in titles[1] and "whose" in titles[2]
    lines = figure.axes[1].get_lines()
    np.testing.assert_allclose(np.asarray(lines[4].get_ydata(), float), weaker.lifted.mean(axis=0))
    counted = sum(
        np.isfinite(np.asarray(line.get_ydata(), float)).sum()
        for line in figure.axes[2].get_lines()[:2]
    )
    assert counted == 8 * 7  # nobody's own attackers
