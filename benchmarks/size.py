"""How much each part computes: the size that is reported, and a tiny one that only shows that
everything runs.
"""

import json
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Literal

from dronecombat_jax.config.fields import (
    Config,
    LearnConfig,
    RunConfig,
    SelfPlayConfig,
    TrainConfig,
)

OBSERVATION_SIZE, ACTION_SIZE = 35, 4

Scope = Literal["chunk", "environment"]


@dataclass(frozen=True)
class Size:
    """Defaults: the paper's settings, and calls of about a second on two cores."""

    num_envs: int = 1000
    seeds: int = 1  # where a part does not say how many
    rollout_steps: int = 24
    hidden_sizes: tuple[int, ...] = (256, 128)
    epochs: int = 5
    minibatches: int = 6
    flown_steps: int = 100  # control steps in a call of the stepping parts
    pool: int = 34  # slots for past players in S-IPPO, as in preset duel
    players: int = 20  # on each side of the tournament
    episodes: int = 5
    cube: int = 2048
    product_gflop: float = 3.0  # in one timed block of products
    triad_floats: int = 2**24  # of each of three arrays; together well beyond any cache
    triad_passes: int = 10
    device: Literal["auto", "cpu", "gpu", "tpu"] = "cpu"
    seeds_at_once: int = 0  # of training: `run.seeds_at_once`

    def config(
        self, num_seeds: int = 1, probability: float = 0.0, scope: Scope = "chunk"
    ) -> Config:
        """The package's defaults, the paper's reading, at this size."""
        train = TrainConfig(num_envs=self.num_envs, num_seeds=num_seeds)
        steps = self.pool * train.chunk_iterations * self.num_envs * self.rollout_steps
        return Config(
            learn=LearnConfig(
                hidden_sizes=self.hidden_sizes,
                rollout_steps=self.rollout_steps,
                epochs=self.epochs,
                minibatches=self.minibatches,
            ),
            train=replace(train, total_steps=steps),
            selfplay=SelfPlayConfig(probability=probability, scope=scope),
            run=RunConfig(device=self.device, seeds_at_once=self.seeds_at_once),
        )

    @property
    def minibatch(self) -> int:
        """Transitions in a mini-batch."""
        return self.num_envs * self.rollout_steps // self.minibatches

    def to_json(self) -> str:
        """All fields, in one line."""
        return json.dumps(asdict(self))

    @staticmethod
    def from_json(text: str) -> "Size":
        """The inverse of `to_json`."""
        fields = json.loads(text)
        return Size(**{**fields, "hidden_sizes": tuple(fields["hidden_sizes"])})


TINY = Size(
    num_envs=4,
    rollout_steps=3,
    hidden_sizes=(8, 8),
    epochs=1,
    minibatches=1,
    flown_steps=2,
    pool=2,
    players=2,
    episodes=1,
    cube=16,
    product_gflop=1e-4,
    triad_floats=2**10,
    triad_passes=1,
)


def mflop_per_step(size: Size) -> float:
    """MFLOP of matrix products per environment step of IPPO with two learners.

    Four networks forward in the rollout; every epoch all of them forward, with the gradients of all
    weights and of the inputs of all layers but the first. Paper settings: 0.336 + 5 (0.336 + 0.336
    + 0.265) = 5.0.
    """
    forward = inputs = 0
    for output in (ACTION_SIZE, 1):  # policy and value
        products = [
            2 * rows * columns
            for rows, columns in pairwise((OBSERVATION_SIZE, *size.hidden_sizes, output))
        ]
        forward += sum(products)
        inputs += sum(products[1:])
    return 2 * (forward + size.epochs * (2 * forward + inputs)) / 1e6
