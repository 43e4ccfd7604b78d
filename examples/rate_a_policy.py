"""Rate a policy, a run or several of them against the scripted pilots."""

import sys

import dronecombat_jax as dc


def main(*entrants: str, episodes: int = 5) -> dict[str, float]:
    """Bradley-Terry ratings in Elo units by name; draws count as half a win."""
    result = dc.tournament([*entrants, "scripted:all"], episodes=episodes)

    from dronecombat_jax.analysis.bradley_terry import bradley_terry
    from dronecombat_jax.analysis.result import scores

    wins, draws, losses = scores(result)
    ratings = bradley_terry(wins, losses, draws)
    names = [entrant.label for entrant in (*result.defenders, *result.attackers)]
    return dict(zip(names, map(float, ratings.rating), strict=True))


if __name__ == "__main__":
    for name, rating in sorted(main(*sys.argv[1:]).items(), key=lambda item: -item[1]):
        print(f"{rating:7.0f}  {name}")
