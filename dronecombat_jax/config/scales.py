"""How large the paper's experiment is made: `dronecombat reproduce --scale NAME`.

The same experiment at every scale: IPPO and S-IPPO from the same seeds, both agents saved after
every chunk, each run's own round robin, the cross-play of all runs. What does not live here: its
steps (`cli.reproduction`), what it costs (`costs`). Nothing imports JAX.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config

# Name of the run: the chance that a chunk is fought against a past attacker.
METHODS = {"ippo": 0.0, "sippo": 0.2}


@dataclass(frozen=True)
class Scale:
    """One size of the experiment."""

    about: str
    preset: str  # the game and the learner
    seeds: int  # of each method: `first`, `first` + 1, ...
    chunks: int
    iterations: int  # of a chunk
    episodes: int  # fights of each pair; the ratings take the first 5, as the paper's do
    every: int  # in the cross-play of all runs a run's every n-th chunk takes part, and the last
    first: int = 0

    @property
    def changes(self) -> dict[str, Any]:
        """Settings beside the preset that all runs have, by dotted key."""
        return {
            "train.seed": self.first,
            "train.num_seeds": self.seeds,
            "train.chunk_iterations": self.iterations,
            "run.video": False,
            "run.replay": False,
        }


SCALES = {
    # Of the first seeds those whose S-IPPO meets a past attacker within four chunks.
    "smoke": Scale("does the whole path run? Nothing is learnt", "smoke", 2, 4, 2, 5, 2),
    # 17 x 1000 x 24 steps: 0.41 M a chunk
    "laptop": Scale("two cores, hours, run in parts", "duel", 8, 100, 17, 10, 10),
    # 1.01 M a chunk
    "gpu": Scale("one large GPU, minutes", "duel", 16, 100, 42, 10, 10),
    # 10.0 M a chunk
    "paper": Scale("the paper's own length and words", "paper", 8, 100, 417, 100, 10),
}


def run_configs(
    scale: Scale, folder: Path, preset: str = "", device: str = "auto"
) -> dict[str, Config]:
    """The settings of each run, by its name; `preset` instead of the scale's own.

    Raises UserError for a preset that is not there, and where the machine is too small for a run.
    """
    chosen = preset or scale.preset
    own = {**scale.changes, "run.directory": str(folder / "runs"), "run.device": device}
    steps = settings.load(chosen, own).steps_per_chunk * scale.chunks
    configs = {}
    for name, probability in METHODS.items():
        given = {
            **own,
            "run.name": name,
            "train.total_steps": steps,
            "selfplay.probability": probability,
        }
        config = settings.load(chosen, given, check_machine=True)
        configs[name] = settings.as_run(config, chosen)
    return configs
