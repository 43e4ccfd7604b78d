"""How much of a tournament is not a matter of strength: the part of the score logits that no rating
explains.

The logits L [D, A] are split into their mean, a part for each defender and each attacker (additive:
strength), and the rest E (doubly centred: who suits whom). E alone is never zero with finitely many
fights: at additive truth its raw share is about 0.52, 0.20 and 0.055 for 5, 20 and 100 fights a
cell (strengths of sd 0.75 in log-odds; more where they lie closer), so it is corrected by a
parametric bootstrap.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from dronecombat_jax.analysis.bradley_terry import POINTS, bradley_terry
from dronecombat_jax.analysis.likelihood import differences


class CyclicShare(NamedTuple):
    """The cyclic part of a tournament's logits."""

    raw: float  # |E|^2 / |L - mean|^2, in [0, 1]; NaN where all logits are equal
    # the same with the noise of finitely many fights taken off both parts; 0 where nothing is left
    corrected: float
    null_mean: float  # mean raw share at additive truth
    null_high: float  # its 95 % quantile
    # of "additive": (1 + bootstrap samples with as large a Pearson chi^2) / (1 + samples)
    p_value: float
    # [D, 2] coordinates: E is about defender_disc @ attacker_disc.T
    defender_disc: NDArray[np.float64]
    attacker_disc: NDArray[np.float64]  # [A, 2]
    disc_share: float  # of |E|^2 that these two dimensions hold
    samples: int  # of the bootstrap


def score_logits(won: NDArray[Any], lost: NDArray[Any]) -> NDArray[np.float64]:
    """Empirical logits [...] of won and lost fights, ties half in each: log((won + 1/2) / (lost +
    1/2)), finite.
    """
    return np.log((won + 0.5) / (lost + 0.5))


def split_logits(logits: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """The additive part without its mean and the cyclic part E of `logits` [..., D, A]; they are
    orthogonal.
    """
    centred = logits - logits.mean(axis=(-2, -1), keepdims=True)
    additive = centred.mean(axis=-1, keepdims=True) + centred.mean(axis=-2, keepdims=True)
    return np.broadcast_to(additive, logits.shape), centred - additive


def cyclic_share(
    wins: NDArray[Any],
    losses: NDArray[Any],
    ties: NDArray[Any],
    bootstrap: int = 400,
    seed: int = 0,
) -> CyclicShare:
    """The cyclic share of fights [D, A] counted from the defender's side; every cell must have been
    played.

    The bootstrap's truth has the Bradley-Terry fit's mean score in every cell and the cell's own
    share of ties, as far as that score allows it; so the test does not lean on a model of ties.
    It counts each cell by what it knows (chi^2), where |E|^2 would let the noise of lopsided cells
    drown the rest; with ties in lopsided cells it errs on the safe side (3 % instead of 5 %).
    Raises ValueError for an empty cell (see `design.complete_part`).
    """
    games = wins + losses + ties
    if not games.size or np.any(games == 0):
        raise ValueError("the cyclic share needs fights in every cell")
    additive, cyclic = split_logits(score_logits(wins + ties / 2, losses + ties / 2))
    strength, energy = np.sum(additive**2), np.sum(cyclic**2)
    null = _bootstrap(wins, losses, ties, bootstrap, np.random.default_rng(seed))
    null_shares = null.energy / np.maximum(null.energy + null.strength, 1e-300)
    rest = max(energy - null.energy.mean(), 0.0)
    solid = max(strength - (null.strength.mean() - null.truth), 0.0)
    left, values, right = np.linalg.svd(cyclic, full_matrices=False)
    scale = np.sqrt(values[:2])
    return CyclicShare(
        raw=float(energy / (energy + strength)) if energy + strength > 0 else np.nan,
        corrected=float(rest / (rest + solid)) if rest > 0 else 0.0,
        null_mean=float(null_shares.mean()),
        null_high=float(np.quantile(null_shares, 0.95)),
        p_value=float((1 + np.sum(null.misfit >= null.observed_misfit - 1e-9)) / (1 + bootstrap)),
        defender_disc=_two(left[:, :2] * scale),
        attacker_disc=_two(right[:2].T * scale),
        disc_share=float(np.sum(values[:2] ** 2) / energy) if energy > 0 else np.nan,
        samples=bootstrap,
    )


class _Null(NamedTuple):
    energy: NDArray[np.float64]  # [B] |E|^2 at additive truth
    strength: NDArray[np.float64]  # [B] |additive part|^2 there
    truth: float  # |additive part|^2 without the fights' noise
    misfit: NDArray[np.float64]  # [B] chi^2 there, of the strengths fitted anew
    observed_misfit: float


def _bootstrap(
    wins: NDArray[Any],
    losses: NDArray[Any],
    ties: NDArray[Any],
    num: int,
    rng: np.random.Generator,
) -> _Null:
    games = (wins + losses + ties).astype(int)
    fitted = bradley_terry(wins, losses, ties)
    x = differences(fitted.rating / POINTS, games.shape)
    rate = expit(x)
    share = np.minimum(ties / games, 2.0 * np.minimum(rate, 1.0 - rate))  # of ties
    decided = np.clip((rate - share / 2) / np.maximum(1.0 - share, 1e-300), 0.0, 1.0)
    variance, covariance = games * rate * (1.0 - rate), fitted.covariance / POINTS**2
    energy, strength, misfit = np.empty(num), np.empty(num), np.empty(num)
    for sample in range(num):  # one at a time: 400 tables of 100 x 100 at once are no faster
        tied = rng.binomial(games, share)
        won = rng.binomial(games - tied, decided) + tied / 2
        additive, cyclic = split_logits(score_logits(won, games - won))
        strength[sample], energy[sample] = np.sum(additive**2), np.sum(cyclic**2)
        misfit[sample] = _misfit(won - games * rate, variance, covariance)
    observed = _misfit(wins + ties / 2 - games * rate, variance, covariance)
    return _Null(energy, strength, float(np.sum(split_logits(x)[0] ** 2)), misfit, observed)


def _misfit(excess: NDArray[Any], variance: NDArray[Any], covariance: NDArray[Any]) -> float:
    """Pearson's chi^2 of what was won in `excess` [D, A], less what one Newton step of the
    strengths would explain.
    """
    slope = np.concatenate([excess.sum(axis=1), -excess.sum(axis=0)])
    return float(np.sum(excess**2 / variance) - slope @ covariance @ slope)


def _two(points: NDArray[Any]) -> NDArray[np.float64]:
    """`points` [N, K <= 2] with the missing columns as zeros."""
    return np.pad(points, ((0, 0), (0, 2 - points.shape[1])))
