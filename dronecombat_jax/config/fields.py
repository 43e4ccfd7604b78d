"""Every setting of the project: frozen dataclasses with a unit, a range and one line each.

What lives here: a whole run's settings, out of `game_fields` and `training_fields`; nothing imports
JAX. What does not: reading TOML, merging flags and reporting errors (`settings`).
"""

from dataclasses import dataclass, field

from dronecombat_jax.config import opponents
from dronecombat_jax.config.game_fields import (
    DroneConfig,
    GameConfig,
    RandomiseConfig,
    RewardConfig,
    SensorConfig,
    SimConfig,
)
from dronecombat_jax.config.setting import setting
from dronecombat_jax.config.sides import Pupil, pupils_of
from dronecombat_jax.config.training_fields import (
    LearnConfig,
    RunConfig,
    SelfPlayConfig,
    TrainConfig,
)

__all__ = [
    "Config",
    "DroneConfig",
    "GameConfig",
    "LearnConfig",
    "RandomiseConfig",
    "RewardConfig",
    "RunConfig",
    "SelfPlayConfig",
    "SensorConfig",
    "SimConfig",
    "TrainConfig",
    "setting",
]


@dataclass(frozen=True)
class Config:
    """A whole run. Defaults < preset file < command-line flags."""

    sim: SimConfig = field(default_factory=SimConfig)
    defender: DroneConfig = field(default_factory=DroneConfig)
    attacker: DroneConfig = field(default_factory=DroneConfig)
    randomise: RandomiseConfig = field(default_factory=RandomiseConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)
    game: GameConfig = field(default_factory=GameConfig)
    reward: RewardConfig = field(default_factory=RewardConfig)
    learn: LearnConfig = field(default_factory=LearnConfig)
    selfplay: SelfPlayConfig = field(default_factory=SelfPlayConfig)
    train: TrainConfig = field(default_factory=TrainConfig)
    run: RunConfig = field(default_factory=RunConfig)

    @property
    def control_dt(self) -> float:
        """Seconds per control step."""
        return self.sim.timestep * self.sim.substeps

    @property
    def steps_per_iteration(self) -> int:
        """Environment steps of one rollout, per seed."""
        return self.train.num_envs * self.learn.rollout_steps

    @property
    def steps_per_chunk(self) -> int:
        """Environment steps of one chunk, per seed."""
        return self.steps_per_iteration * self.train.chunk_iterations

    @property
    def pupils(self) -> tuple[Pupil, ...]:
        """Who learns, in the order of all learners."""
        return pupils_of(self.game.sides, self.learn.mates)

    @property
    def solo_envs(self) -> int:
        """Environments in which the attacker flies alone: the first ones."""
        first, *_ = opponents.places(self)
        return first.stop if first.row and first.row.who == opponents.NOBODY else 0

    @property
    def num_chunks(self) -> int:
        """Chunks of the run: `total_steps` rounded up."""
        return -(-self.train.total_steps // self.steps_per_chunk)

    @property
    def head_start_chunks(self) -> int:
        """Chunks in which the attacker alone learns; none where one side never does."""
        if not all(opponents.learns(self, side) for side in range(len(opponents.SIDES))):
            return 0
        return -(-self.train.head_start_steps // self.steps_per_chunk)
