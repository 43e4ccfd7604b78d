"""Rate a policy on the ladder that comes with the package: python rate_your_policy.py FILE-OR-RUN"""

import sys
from typing import Any

import dronecombat_jax as dc


def main(policy: str, **options: Any) -> dict[str, float]:
    """Ratings by role, in Elo points; `options` as those of `dronecombat_jax.rate`."""
    rated = dc.rate(policy, **options)
    for each in rated:
        place = f"place {each.place} of {each.places}"
        print(
            f"{each.role} {each.name}: {each.rating:.0f} [{each.low:.0f}, {each.high:.0f}], {place}"
        )
        for opponent, score in each.worst:
            print(f"    scores {score:.2f} against {opponent}")
    return {each.role: each.rating for each in rated}


if __name__ == "__main__":
    main(sys.argv[1])
