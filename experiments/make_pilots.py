"""Make the pilots that come with the package: policies of runs, rounded, rated, each with a card.

    python experiments/make_pilots.py ippo=runs/ippo sippo=runs/sippo --episodes 20

Of each run the final policies of both sides and nine earlier ones, evenly spaced. Weights are
rounded to 11 significant bits, which halves the size of the wheel; what is rated is the rounded
policy. Ratings: Bradley-Terry over all of these and the scripted pilots, every pair meeting
`--episodes` times from the game's own starts.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np

from dronecombat_jax import load_run, prepare, tournament
from dronecombat_jax.policies import shipped
from dronecombat_jax.tournaments.contenders import find

PER_RUN = 10
BITS = 11  # significant
WORST = 3


def rounded(array: np.ndarray) -> np.ndarray:
    """`array`, each number rounded to BITS significant bits; float32."""
    mantissa, exponent = np.frexp(np.asarray(array, np.float32))
    return np.ldexp(np.round(mantissa * 2**BITS) / 2**BITS, exponent).astype(np.float32)


def export(method: str, run: Path) -> None:
    """Write the policies of one run."""
    import jax

    from dronecombat_jax.files import checkpoint
    from dronecombat_jax.files.rundir import RunDirectory
    from dronecombat_jax.policies.file import save_policy
    from dronecombat_jax.runs.export import policy_of_run
    from dronecombat_jax.types import SIDES

    directory = RunDirectory(run)
    size = load_run(run).config.train.chunk_iterations
    chunks = [step // size for step in checkpoint.steps(directory.checkpoints) if step % size == 0]
    wanted = np.linspace(0, chunks[-1], PER_RUN + 1)[1:].round().astype(int)
    for chunk in wanted:
        saved = load_run(run, int(chunk))
        for side in SIDES:
            policy, info = policy_of_run(saved, directory, side, None)
            policy = policy.replace(network=jax.tree.map(rounded, policy.network))
            path = shipped.FOLDER / f"{method}-{side}-{chunk}.safetensors"
            save_policy(path, policy, info, force=True)
            print(path.name)


def rate(commands: dict[str, str], episodes: int) -> dict[str, dict]:
    """The card of every pilot."""
    from dronecombat_jax.analysis.bradley_terry import bradley_terry
    from dronecombat_jax.analysis.result import score_rate, scores

    with tempfile.TemporaryDirectory() as root:
        entrants = [f"{shipped.PREFIX}all", "scripted:all"]
        result = tournament(entrants, episodes=episodes, name="pilots", root=root)
    wins, draws, losses = scores(result)
    ratings, rate = bradley_terry(wins, losses, draws), score_rate(result)
    sides = result.defenders, result.attackers
    # a policy that both runs saved alike flew once, under the first of its names
    named: dict[str, list[str]] = {}
    for name in shipped.names():
        (contender,) = find(f"{shipped.PREFIX}{name}").contenders
        named.setdefault(contender.entrant.identity, []).append(name)
    cards = {}
    for index, entrant in enumerate([*sides[0], *sides[1]]):
        defends = index < len(sides[0])
        score = rate[index] if defends else 1.0 - rate[:, index - len(sides[0])]
        others = sides[1] if defends else sides[0]
        worst = np.argsort(score, kind="stable")[:WORST]
        card = {
            "steps": entrant.steps,
            "rating": round(float(ratings.rating[index]), 1),
            "low": round(float(ratings.low[index]), 1),
            "high": round(float(ratings.high[index]), 1),
            "loses_to": [f"{others[i].label} ({score[i]:.2f})" for i in worst if score[i] < 0.5],
        }
        for name in named.get(entrant.identity, ()):
            cards[name] = {"trained": commands[name.partition("-")[0]], **card}
    return cards


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="*", help="METHOD=RUN")
    parser.add_argument("--episodes", type=int, default=20)
    given = parser.parse_args()
    prepare("cpu")
    shipped.FOLDER.mkdir(exist_ok=True)
    for word in given.runs:
        method, _, run = word.partition("=")
        export(method, Path(run))
    commands = {"ippo": "make train-ippo", "sippo": "make train-sippo"}
    cards = rate(commands, given.episodes)
    table = json.dumps(cards, indent=1, sort_keys=True)
    (shipped.FOLDER / shipped.CARDS).write_text(table + "\n")


if __name__ == "__main__":
    main()
