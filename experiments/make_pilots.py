"""Make the pilots that come with the package: policies of runs, rounded, rated, each with a card.

    python experiments/make_pilots.py ippo=runs/ippo sippo=runs/sippo --episodes 100
    python experiments/make_pilots.py responder-attacker-6=FILE

Of each run the final policies of both sides and nine earlier ones, evenly spaced; a policy file alone
under a name of its own. Weights are rounded to 11 significant bits, which halves the size of the wheel; what is rated is
the rounded policy. Their ratings are those of the ladder, which is made anew: `make_ladder.py`; not with `--episodes 0`.
"""

import argparse
import json
from pathlib import Path

import make_ladder
import numpy as np

from dronecombat_jax import load_policy, load_run, prepare
from dronecombat_jax.policies import shipped
from dronecombat_jax.tournaments.contenders import find

PER_RUN = 10
BITS = 11  # significant
COMMANDS = {
    "ippo": "make train-ippo",
    "sippo": "make train-sippo",
    "strong": "experiments/variants.py experiments/studies/strength.toml --only strong-untaught",
    "league": "experiments/variants.py experiments/studies/strength.toml --only league-last",
    "responder": "dronecombat exploit PILOT --preset responder --budget 40e6",
}


def rounded(array: np.ndarray) -> np.ndarray:
    """`array`, each number rounded to BITS significant bits; float32."""
    mantissa, exponent = np.frexp(np.asarray(array, np.float32))
    return np.ldexp(np.round(mantissa * 2**BITS) / 2**BITS, exponent).astype(np.float32)


def export(method: str, run: Path) -> None:
    """Write the policies of one run."""
    from dronecombat_jax.files import checkpoint
    from dronecombat_jax.files.rundir import RunDirectory
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
            write(f"{method}-{side}-{chunk}", policy, info)


def write(name: str, policy, info) -> None:
    """Write one policy, rounded, under the name of a pilot."""
    import jax

    from dronecombat_jax.policies.file import save_policy

    policy = policy.replace(network=jax.tree.map(rounded, policy.network))
    save_policy(shipped.FOLDER / f"{name}.safetensors", policy, info, force=True)
    print(name)


def card(path: Path) -> dict:
    """What a pilot's file says of its training; the ladder adds how it rates."""
    (contender,) = find(f"{shipped.PREFIX}{path.stem}").contenders
    command = COMMANDS[path.stem.partition("-")[0]]
    return {"trained": command, "steps": contender.entrant.steps}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="*", help="METHOD=RUN or METHOD-SIDE-NUMBER=FILE")
    parser.add_argument("--episodes", type=int, default=100)
    given = parser.parse_args()
    prepare("cpu")
    shipped.FOLDER.mkdir(exist_ok=True)
    for word in given.runs:
        name, _, path = word.partition("=")
        if Path(path).is_dir():
            export(name, Path(path))
        else:
            saved = load_policy(path)
            write(name, saved.policy, saved.info)
    cards = {path.stem: card(path) for path in shipped.paths(shipped.ALL)}
    (shipped.FOLDER / shipped.CARDS).write_text(json.dumps(cards))
    if given.episodes:
        make_ladder.write_all(given.episodes)


if __name__ == "__main__":
    main()
