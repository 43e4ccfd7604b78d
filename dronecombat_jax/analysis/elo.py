"""Sequential Elo as the paper prints it (eq. 3, 4), averaged over random orders of the fights.

Its spread over orders never shrinks with more fights: about 9.3 sqrt(K) points. Order-free ratings:
`bradley_terry`.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.analysis.result import TournamentResult, fight_scores

START = 1500.0  # points
K_FACTOR = 32.0  # points; K of eq. 4
LOGISTIC = np.log(10.0) / 400.0  # per point: eq. 3 in powers of e


class EloRatings(NamedTuple):
    """Elo points.

    Gauge: the mean over all entrants of both sides is the start, since a fight moves both by as
    much.
    """

    defender: NDArray[np.float64]  # [D] mean over orders
    attacker: NDArray[np.float64]  # [A]
    defender_spread: NDArray[np.float64]  # [D] standard deviation over orders; NaN for one order
    attacker_spread: NDArray[np.float64]  # [A]
    defender_games: NDArray[np.integer]  # [D] fights rated; 0: still at the start, not rated
    attacker_games: NDArray[np.integer]  # [A]
    orders: int


def elo_ratings(
    result: TournamentResult,
    orders: int = 32,
    seed: int = 0,
    k_factor: float = K_FACTOR,
    start: float = START,
) -> EloRatings:
    """Rate all played fights in `orders` random orders drawn from `seed`.

    The orders do not depend on how the entrants are listed, only on who they are.
    """
    if orders < 1:
        raise ValueError(f"{orders} orders")
    size = result.played.shape
    fights = _fights_by_identity(result)
    final = np.empty((orders, sum(size)))
    for order in range(orders):
        shuffled = np.random.default_rng([seed, order]).permutation(fights)
        final[order] = np.concatenate(
            play_in_order(*_decode(shuffled, size), size, k_factor, start)
        )
    spread = np.std(final, axis=0, ddof=1) if orders > 1 else np.full(sum(size), np.nan)
    split = lambda both: (both[: size[0]], both[size[0] :])
    games = result.played * result.cause.shape[2]
    return EloRatings(
        *split(final.mean(axis=0)), *split(spread), games.sum(axis=1), games.sum(axis=0), orders
    )


def play_in_order(
    defender: NDArray[Any],
    attacker: NDArray[Any],
    score: NDArray[Any],
    size: tuple[int, int],
    k_factor: float = K_FACTOR,
    start: float = START,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Final ratings [D] and [A], of `size` (D, A), after the fights [N] in the order given.

    `defender`, `attacker` [N] are indices, `score` [N] is the defender's S of eq. 4: 1, 1/2 or 0.
    """
    with jax.enable_x64(True):
        # in single precision 10^4 updates at 1500 points lose the sum in the third digit
        initial = (jnp.full(size[0], float(start)), jnp.full(size[1], float(start)))
        fights = (
            jnp.asarray(defender, jnp.int32),
            jnp.asarray(attacker, jnp.int32),
            jnp.asarray(score, float),
        )
        final = jax.device_get(_scan(initial, fights, float(k_factor)))
    return np.asarray(final[0]), np.asarray(final[1])


@jax.jit
def _scan(
    initial: tuple[Any, ...], fights: tuple[Any, ...], k_factor: jax.Array
) -> tuple[Any, ...]:
    def fight(ratings: tuple[Any, ...], played: tuple[Any, ...]) -> tuple[tuple[Any, ...], None]:
        defenders, attackers = ratings
        defender, attacker, score = played
        # eq. 3
        expected = 1.0 / (1.0 + jnp.exp((attackers[attacker] - defenders[defender]) * LOGISTIC))
        # eq. 4; the attacker's is its negative, for E_A + E_B = 1
        change = k_factor * (score - expected)
        return (defenders.at[defender].add(change), attackers.at[attacker].add(-change)), None

    return jax.lax.scan(fight, initial, fights, unroll=4)[0]


def _fights_by_identity(result: TournamentResult) -> NDArray[np.int32]:
    """Every played fight as one number (cell x 3 + doubled score), listed in an order fixed by the
    identities.
    """
    first = np.argsort([entrant.identity for entrant in result.defenders], kind="stable")
    second = np.argsort([entrant.identity for entrant in result.attackers], kind="stable")
    cell = np.arange(result.played.size, dtype=np.int32).reshape(result.played.shape)
    doubled = 2.0 * np.nan_to_num(fight_scores(result))
    fights = cell[:, :, None] * 3 + doubled.astype(np.int32)
    grid = np.ix_(first, second)
    return fights[grid][result.played[grid]].reshape(-1)


def _decode(
    fights: NDArray[np.int32], size: tuple[int, int]
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    cell, doubled = np.divmod(fights, 3)
    defender, attacker = np.divmod(cell, size[1])
    return defender, attacker, doubled * 0.5
