"""Log-likelihoods of Bradley-Terry and Davidson by cell, and Newton's method for their strengths.

x = (defender's strength - attacker's strength), in units of the log-odds. Players: defenders first,
P = D + A.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.special import expit, log_expit


class Cells(NamedTuple):
    """Log-likelihood and its derivatives by cell, each [D, A], in x and in the logarithm of nu."""

    value: NDArray[Any]
    slope: NDArray[Any]  # in x
    curvature: NDArray[Any]  # minus the second derivative in x
    tie_slope: NDArray[Any]
    tie_curvature: NDArray[Any]
    cross: NDArray[Any]


def bernoulli_cells(won: NDArray[Any], lost: NDArray[Any], x: NDArray[Any]) -> Cells:
    """Bradley-Terry at differences `x` [D, A]."""
    games, rate = won + lost, expit(x)
    nothing = np.zeros_like(x)
    value = won * log_expit(x) + lost * log_expit(-x)
    return Cells(value, won - games * rate, games * rate * expit(-x), nothing, nothing, nothing)


def davidson_cells(
    wins: NDArray[Any], losses: NDArray[Any], ties: NDArray[Any], x: NDArray[Any], log_nu: float
) -> Cells:
    """Davidson's model at differences `x` [D, A]: an exponential family in (win - loss) / 2, tie."""
    total = np.logaddexp(np.logaddexp(x / 2, -x / 2), log_nu)
    win, lose, tie = np.exp(x / 2 - total), np.exp(-x / 2 - total), np.exp(log_nu - total)
    games, lean = wins + losses + ties, (win - lose) / 2
    return Cells(
        value=(wins - losses) * x / 2 + ties * log_nu - games * total,
        slope=(wins - losses) / 2 - games * lean,
        curvature=games * ((win + lose) / 4 - lean**2),
        tie_slope=ties - games * tie,
        tie_curvature=games * tie * (1 - tie),
        cross=-games * lean * tie,
    )


def fit(
    cells: Callable[[NDArray[Any], float], Cells],
    precision: NDArray[Any],
    size: tuple[int, int],
    with_ties: bool = False,
) -> tuple[NDArray[Any], NDArray[Any], float]:
    """Maximise log-likelihood - theta' Q theta / 2 by Newton, Q = `precision`; the target is
    concave.

    theta [P] or, `with_ties`, [P + 1] with log nu last. Returns theta, the inverse of minus the
    Hessian, and the log-likelihood. Raises ArithmeticError if 200 steps do not reach the maximum.
    """
    theta = np.zeros(len(precision))
    split = lambda theta: (theta[:-1], float(theta[-1])) if with_ties else (theta, 0.0)

    def evaluate(theta: NDArray[Any]) -> tuple[float, Cells]:
        strength, log_nu = split(theta)
        at = cells(differences(strength, size), log_nu)
        return float(at.value.sum()), at

    value, at = evaluate(theta)
    for _ in range(200):
        gradient, hessian = _derivatives(at, with_ties)
        gradient, hessian = gradient - precision @ theta, hessian + precision
        factor = cho_factor(hessian)
        step = cho_solve(factor, gradient)
        decrement, objective, length = gradient @ step, value - theta @ precision @ theta / 2, 1.0
        while True:
            new = theta + length * step
            value, at = evaluate(new)
            # Near the maximum the gain drowns in the value's rounding; Newton's whole step is right
            # there.
            if (
                decrement < 1e-6
                or value - new @ precision @ new / 2 >= objective + 0.1 * length * decrement
            ):
                break
            length /= 2
        theta = new
        if decrement < 1e-18 * max(1.0, abs(value)):
            # squared error in standard errors, before this step
            return theta, cho_solve(factor, np.eye(len(theta))), value
    raise ArithmeticError("the ratings' Newton iteration does not converge")


def differences(theta: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    """x [D, A] of strengths `theta` [P]."""
    return theta[: size[0], None] - theta[None, size[0] :]


def _derivatives(at: Cells, with_ties: bool) -> tuple[NDArray[Any], NDArray[Any]]:
    """Gradient, and minus the Hessian, in theta."""
    both = lambda cell: np.concatenate([cell.sum(axis=1), -cell.sum(axis=0)])
    gradient, hessian = both(at.slope), np.diag(np.abs(both(at.curvature)))
    num_defenders = len(at.value)
    hessian[:num_defenders, num_defenders:] = -at.curvature
    hessian[num_defenders:, :num_defenders] = -at.curvature.T
    if not with_ties:
        return gradient, hessian
    cross = both(at.cross)[:, None]
    corner = np.block([[hessian, cross], [cross.T, np.reshape(at.tie_curvature.sum(), (1, 1))]])
    return np.append(gradient, at.tie_slope.sum()), corner
