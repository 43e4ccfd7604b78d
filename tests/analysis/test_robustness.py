"""Loss of score and of ranks under a change, by tournaments written out and planted ones."""

import numpy as np
import pytest
from scipy import stats
from tournaments import bradley_terry_rates, build, from_letters, from_rates

from dronecombat_jax.analysis.robustness import effect, rank_correlations
from dronecombat_jax.errors import UserError
from dronecombat_jax.types import ATTACKER, DEFENDER

NOMINAL = [["wwd", "wll"], ["www", "wld"]]
CHANGED = [["wld", "lll"], ["wdl", "..."]]


def test_losses_and_their_interval_by_hand():
    """Cells flown in both: wwd wll www against wld lll wdl; by start 1 2/3 1/2, then 2/3 1/6 1/6."""
    nominal, changed = from_letters(NOMINAL), from_letters(CHANGED)
    defender = effect(nominal, changed, DEFENDER)
    losses = np.array([1 - 2 / 3, 2 / 3 - 1 / 6, 1 / 2 - 1 / 6])
    assert defender.nominal == pytest.approx(13 / 18) and defender.score == pytest.approx(1 / 3)
    assert defender.loss == pytest.approx(losses.mean()) and defender.fights == 9
    half = stats.t.interval(0.95, 2, scale=losses.std(ddof=1) / 3**0.5)[1]
    assert (defender.low, defender.high) == pytest.approx(
        (losses.mean() - half, losses.mean() + half)
    )
    attacker = effect(nominal, changed, ATTACKER)
    assert attacker.loss == pytest.approx(-defender.loss) and attacker.players == 2
    assert attacker.nominal == pytest.approx(1 - defender.nominal)
    assert np.isnan(attacker.kendall) and np.isnan(attacker.spearman)  # two players have no ranks


def test_one_start_has_no_interval():
    one = effect(from_letters([["w"]]), from_letters([["l"]]), DEFENDER)
    assert one.loss == 1.0 and np.isnan(one.low) and np.isnan(one.high)


def test_a_planted_order_is_kept_or_turned_round():
    defenders, attackers = np.linspace(-1.5, 1.5, 6), np.linspace(-1.0, 1.0, 5)
    rates = bradley_terry_rates(defenders, attackers)
    nominal, same, turned = (
        from_rates(win, 400, seed)
        for seed, win in enumerate((rates, rates, bradley_terry_rates(-defenders, attackers)))
    )
    for role in (DEFENDER, ATTACKER):
        alike = effect(nominal, same, role)
        assert alike.kendall > 0.9 and alike.spearman > 0.9
        assert alike.low < 0 < alike.high and abs(alike.loss) < 0.02
    other = effect(nominal, turned, DEFENDER)
    assert other.kendall < -0.9 and effect(nominal, turned, ATTACKER).kendall > 0.9
    weaker = from_rates(bradley_terry_rates(defenders - 1.0, attackers), 400, 9)
    lost = effect(nominal, weaker, DEFENDER)
    true = np.mean(rates - bradley_terry_rates(defenders - 1.0, attackers))
    assert lost.low < true < lost.high and lost.low > 0.1


def test_correlations_by_hand_and_what_has_none():
    """1 2 3 4 against 1 3 2 4: one of six pairs is turned, 1 - 2/6; rho = 1 - 6 * 2 / (4 * 15)."""
    tau, rho = rank_correlations(np.array([1.0, 2, 3, 4]), np.array([1.0, 3, 2, 4]))
    assert tau == pytest.approx(2 / 3) and rho == pytest.approx(0.8)
    assert np.isnan(rank_correlations(np.ones(4), np.arange(4.0))).all()


def test_other_players_and_nothing_in_common_are_refused():
    nominal = from_letters(NOMINAL)
    with pytest.raises(UserError, match="other players or lengths"):
        effect(nominal, build(nominal.cause[:1]), DEFENDER)
    rest = from_letters([["...", "..."], ["...", "www"]])
    with pytest.raises(UserError, match="no cell"):
        effect(from_letters([["www", "..."], ["...", "..."]]), rest, DEFENDER)
