"""The table after a tournament: the best of both sides by their Bradley-Terry ratings."""

import numpy as np

from dronecombat_jax.analysis.bradley_terry import Ratings, bradley_terry
from dronecombat_jax.analysis.design import OPEN_ABOVE, OPEN_BELOW
from dronecombat_jax.analysis.result import Entrant, TournamentResult, score_rate, scores
from dronecombat_jax.types import SIDES

TOP = 8
GAUGE = "Elo points; the mean over all players of both sides is 1500, and only differences within this tournament count"


def standings_text(result: TournamentResult, top: int = TOP) -> str:
    """The `top` defenders and attackers: rating, standard error, 95 % interval, mean score, fights."""
    wins, ties, losses = scores(result)
    ratings = bradley_terry(wins, losses, ties)
    rate = score_rate(result)
    played = result.played
    average = lambda axis: (
        np.where(played, rate, 0.0).sum(axis=axis) / np.maximum(played.sum(axis=axis), 1)
    )
    mean = np.concatenate([average(1), 1.0 - average(0)])
    lines = [f"Bradley-Terry ratings ({GAUGE}):"]
    first = 0
    for role, side in enumerate((result.defenders, result.attackers)):
        players = np.arange(first, first + len(side))
        players = players[ratings.design.games[players] > 0]
        best = players[np.argsort(-ratings.rating[players], kind="stable")][:top]
        lines.append(f"  {SIDES[role]:<28} rating  +-    95 % interval    score   fights")
        lines += [
            f"  {_row(ratings, side[player - first], player, float(mean[player]))}"
            for player in best
        ]
        lines += [f"  ... and {len(players) - len(best)} more"] * (len(players) > len(best))
        first += len(side)
    if len(np.unique(ratings.design.component[ratings.design.games > 0])) > 1:
        lines.append(
            "not all players are linked by fights: ratings of unlinked groups cannot be compared"
        )
    return "\n".join(lines)


def _row(ratings: Ratings, entrant: Entrant, player: int, score: float) -> str:
    bound = {OPEN_ABOVE: "  open above", OPEN_BELOW: "  open below"}.get(
        int(ratings.design.bound[player]), ""
    )
    bound = {1.0: "  never beaten", 0.0: "  never won"}.get(score, bound)
    interval = f"[{ratings.low[player]:.0f}, {ratings.high[player]:.0f}]"
    return (
        f"{entrant.label[:28]:<28} {ratings.rating[player]:6.0f} {ratings.error[player]:4.0f}  {interval:<16} "
        f"{score:6.3f} {ratings.design.games[player]:8,.0f}{bound}"
    )
