"""Cross-plays with a known difference between methods."""

import numpy as np
from scipy.special import expit
from tournaments import entrants, from_rates

from dronecombat_jax.analysis.panel import Panel, fill_home, mean_scores

METHODS = ("ippo", "s-ippo")


NAN = np.nan


def cross_play(gap, seed=0, seeds=6, weaker_attackers=0.0, spread=0.15, episodes=200):
    """`seeds` runs of each method with two chunks each, and pilots; the second method's defenders
    are `gap` better.
    """
    rng = np.random.default_rng(seed)
    defenders, attackers = entrants("d", seeds, 2, METHODS, 1), entrants("a", seeds, 2, METHODS, 2)
    lift = {one.lineage: rng.normal(gap * (one.method == "s-ippo"), spread) for one in defenders}
    weak = {
        one.lineage: rng.normal(weaker_attackers * (one.method == "s-ippo"), spread)
        for one in attackers
    }
    x = np.asarray(
        [[lift[one.lineage] + weak[other.lineage] for other in attackers] for one in defenders]
    )
    return from_rates(expit(x), episodes, seed, defenders=defenders, attackers=attackers)


def panel_of(table, methods):
    """A panel of one attacker a run and no pilots."""
    names = tuple(f"{method}-{index}" for index, method in enumerate(methods))
    ones, seeds = np.ones(len(names)), tuple(range(len(names)))
    filled = fill_home(table, ones)
    return Panel(
        runs=names,
        methods=tuple(methods),
        seeds=seeds,
        steps=seeds,
        adjusted=mean_scores(filled, ones),
        plain=np.nanmean(table, axis=1),
        fights=np.ones(len(names), int),
        table=table,
        filled=filled,
        groups=names,
        group_methods=tuple(methods),
        weights=ones,
        missing=(),
        dropped=(),
    )
