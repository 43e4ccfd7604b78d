"""Rate a policy on the ladder that comes with the package: python rate_your_policy.py FILE-OR-RUN"""

import sys
from typing import Any

import dronecombat_jax as dc


def main(policy: str, **options: Any) -> dict[str, float]:
    """Ratings by role, in Elo points; `options` as those of `dronecombat_jax.rate`."""
    rated = dc.rate(policy, **options)
    for one in rated:
        place = f"place {one.place} of {one.places}"
        print(f"{one.role} {one.name}: {one.rating:.0f} [{one.low:.0f}, {one.high:.0f}], {place}")
        for opponent, score in one.worst:
            print(f"    scores {score:.2f} against {opponent}")
    return {one.role: one.rating for one in rated}


if __name__ == "__main__":
    main(sys.argv[1])
