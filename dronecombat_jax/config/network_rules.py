"""What the settings of the networks must fulfil beside the others, before anything is allocated.

What does not live here: the memory of the machine and batches (`preflight`). Nothing imports JAX.
"""

from collections.abc import Iterator

from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.opponents import SIDES, live_part
from dronecombat_jax.config.problem import Problem


def broken(config: Config) -> Iterator[Problem]:
    """All rules that the networks break."""
    if config.learn.others == "mean" and config.game.observation != "nearest":
        yield Problem(
            ("learn.others", "game.observation"),
            "learn.others = mean needs game.observation = nearest: no other has slots for others, and "
            f"{config.game.observation} is given",
        )
    if config.learn.others == "mean" and config.learn.algorithm != "ppo":
        yield Problem(
            ("learn.others", "learn.algorithm"),
            f"learn.others = mean needs learn.algorithm = ppo: the networks of {config.learn.algorithm} are its own business",
        )
    yield from _memory(config)
    yield from _recurrent(config)


def _memory(config: Config) -> Iterator[Problem]:
    learn = config.learn
    if learn.memory != "none" and learn.others != "flat":
        yield Problem(
            ("learn.memory", "learn.others"),
            f"learn.memory = {learn.memory} needs learn.others = flat: slots of others are seen as they are now",
        )
    if learn.memory != "none" and learn.algorithm != "ppo":
        yield Problem(
            ("learn.memory", "learn.algorithm"),
            f"learn.memory = {learn.memory} needs learn.algorithm = ppo: what {learn.algorithm} remembers is its own business",
        )


def _recurrent(config: Config) -> Iterator[Problem]:
    cuts = config.learn.minibatches
    counts = {
        part.stop - part.start for part in (live_part(config, side) for side in range(len(SIDES)))
    }
    if config.learn.memory == "gru" and any(count % cuts for count in counts):
        spelt = " and ".join(str(count) for count in sorted(counts))
        yield Problem(
            ("learn.minibatches", "learn.memory", "train.num_envs"),
            f"learn.memory = gru cuts mini-batches by environments: learn.minibatches = {cuts} must divide "
            f"those that a side learns from, {spelt}",
        )
