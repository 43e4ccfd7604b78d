"""Make `alpha_rank.json` with OpenSpiel's alpha-Rank: `python
tests/golden/make_alpha_rank_golden.py`.

The project does not depend on OpenSpiel. A scratch environment (Python 3.12) that makes the same
file:

    pip install open_spiel==2.0.2 numpy==2.5.5 scipy==1.18.1 matplotlib==3.11.2 networkx==3.7
"""

import json
from importlib.metadata import version
from pathlib import Path

import numpy as np
from open_spiel.python.egt import alpharank

DEFENDERS, ATTACKERS = 6, 5
SETTINGS = [(0.1, 50), (1.0, 50), (5.0, 20), (20.0, 10)]  # alpha, population


def main() -> None:
    rng = np.random.default_rng(20)
    scores = rng.integers(0, 21, (DEFENDERS, ATTACKERS)) / 20
    cases = []
    for alpha, population in SETTINGS:
        pi = alpharank.compute([scores, 1 - scores], m=population, alpha=alpha)[2]
        # How profiles are numbered is OpenSpiel's affair.
        order = [
            alpharank.utils.get_strat_profile_from_id([DEFENDERS, ATTACKERS], one)
            for one in range(DEFENDERS * ATTACKERS)
        ]
        table = np.zeros((DEFENDERS, ATTACKERS))
        for (defender, attacker), mass in zip(order, pi, strict=True):
            table[defender, attacker] = mass
        cases.append({"alpha": alpha, "population": population, "profile": table.tolist()})
    golden = {"open_spiel": version("open_spiel"), "scores": scores.tolist(), "cases": cases}
    Path(__file__).with_name("alpha_rank.json").write_text(json.dumps(golden, indent=1) + "\n")


if __name__ == "__main__":
    main()
