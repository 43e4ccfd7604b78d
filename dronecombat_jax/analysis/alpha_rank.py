"""alpha-Rank (Omidshafiei et al. 2019) of the two populations: how long evolution stays with each
entrant.

The chain lives on the joint profiles (defender, attacker). Its transition matrix, (D A)^2 numbers,
is never formed.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs


class AlphaRank(NamedTuple):
    """The stationary distribution of the chain."""

    profile: NDArray[np.float64]  # [D, A] adds up to 1
    defender: NDArray[np.float64]  # [D] its marginal
    attacker: NDArray[np.float64]  # [A]
    # certificate: total change of the distribution in one step of the chain; 0 at the exact one
    residual: float


def alpha_rank(
    scores: NDArray[Any], alpha: float = 10.0, population: int = 50, tolerance: float = 1e-12
) -> AlphaRank:
    """Rank by M = `scores` [D, A], the defender's mean scores; the attacker's are 1 - M.

    One side at a time a mutant of another strategy appears, each equally likely, and takes over its
    `population` with the fixation probability (1 - e^-u) / (1 - e^-(population u)), u = `alpha` x
    gain. Power steps follow a Krylov start until the residual is below `tolerance`, 2000 at most:
    the larger `alpha`, the slower the chain mixes, so look at the residual. Raises ValueError for
    NaN.
    """
    scores = np.asarray(scores, float)
    if not scores.size or np.isnan(scores).any():
        raise ValueError("alpha-Rank needs every cell")
    size = scores.shape
    moves = max(sum(size) - 2, 1)  # the mutants that may appear
    gain_defender = scores[None, :, :] - scores[:, None, :]  # [from, to, A]
    # [D, from, to]: what the defender loses
    gain_attacker = scores[:, :, None] - scores[:, None, :]
    # [A, from, to]
    defender_moves = np.moveaxis(_fixation(gain_defender, alpha, population), 2, 0) / moves
    attacker_moves = _fixation(gain_attacker, alpha, population) / moves
    for block in (defender_moves, attacker_moves):
        block[:, np.arange(block.shape[1]), np.arange(block.shape[1])] = 0.0
    leaving = defender_moves.sum(axis=2).T + attacker_moves.sum(axis=2)

    def step(flat: NDArray[Any]) -> NDArray[Any]:
        mass = flat.reshape(size)
        arriving = np.matmul(mass.T[:, None, :], defender_moves)[:, 0, :].T
        arriving = arriving + np.matmul(mass[:, None, :], attacker_moves)[:, 0, :]
        return (arriving + mass * (1.0 - leaving)).reshape(-1)

    mass = _krylov(step, scores.size)
    residual = np.inf
    for _ in range(2000):
        new = step(mass)
        residual = float(np.abs(new - mass).sum())
        mass = new / new.sum()
        if residual < tolerance:
            break
    profile = mass.reshape(size)
    return AlphaRank(profile, profile.sum(axis=1), profile.sum(axis=0), residual)


def _fixation(gain: NDArray[Any], alpha: float, population: int) -> NDArray[np.float64]:
    """Probability that one mutant with `gain` takes over; 1 / population without gain."""
    u = np.clip(alpha * gain, -700.0 / population, 700.0 / population)
    neutral = np.abs(u) < 1e-12
    safe = np.where(neutral, 1.0, u)
    return np.where(neutral, 1.0 / population, np.expm1(-safe) / np.expm1(-population * safe))


class _Chain(LinearOperator):
    def __init__(self, step: Callable[[NDArray[Any]], NDArray[Any]], size: int):
        super().__init__(np.dtype(float), (size, size))
        self._step = step

    def _matvec(self, x: NDArray[Any]) -> NDArray[Any]:
        return self._step(x)


def _krylov(step: Callable[[NDArray[Any]], NDArray[Any]], size: int) -> NDArray[np.float64]:
    """An approximate fixed point of `step` on [size], or the uniform distribution where Arnoldi's
    method finds none.
    """
    uniform = np.full(size, 1.0 / size)
    if size < 4:
        return uniform
    try:
        vectors = eigs(_Chain(step, size), k=1, which="LM", v0=uniform, maxiter=100)[1]
        vector = np.abs(np.real(vectors)[:, 0])
    except ArpackNoConvergence:
        return uniform
    return vector / vector.sum() if np.isfinite(vector).all() and vector.sum() > 0 else uniform
