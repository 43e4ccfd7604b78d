"""What the settings of the networks must fulfil beside the others, before anything is allocated.

What does not live here: memory and batches (`preflight`). Nothing imports JAX.
"""

from collections.abc import Iterator

from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.problem import Problem


def broken(config: Config) -> Iterator[Problem]:
    """All rules that the networks break."""
    if config.learn.others == "mean" and config.game.observation != "nearest":
        yield Problem(
            ("learn.others", "game.observation"),
            "learn.others = mean needs game.observation = nearest: no other has slots for others, and "
            f"{config.game.observation} is given",
        )
