"""Every pytree that crosses a room's border, with its axes and units.

Axes, always in this order: S seeds, T time, N environments, A agents. Agents are drones: all
defenders, then all attackers (`GameConfig.sides`). There are always two sides, 0 the defender's and
1 the attacker's; pools and tournaments have sides. L are those who learn (`Config.pupils`): sides, or
drones. Where each side has one drone, all these are the same number. Lengths that depend on A are
given for two drones.
What does not live here: settings (`config`) and anything that computes.
"""

from dronecombat_jax.types.fights import (
    ACTION_SIZE,
    ATTACKER,
    DEFENDER,
    NUM_SIDES,
    OBSERVATION_SIZE,
    SIDES,
    Cause,
    Craft,
    Drawn,
    Drones,
    EnvState,
    FightRecord,
    FightResult,
    Outcome,
    RewardTerms,
    StepOutput,
    Trajectory,
)
from dronecombat_jax.types.learning import (
    GRU,
    MLP,
    Batch,
    Encoder,
    Flown,
    IterationMetrics,
    Learner,
    Parameters,
    Policy,
    Pool,
    Scaler,
    SelfPlay,
    SidePolicy,
    TeamPolicy,
    TrainState,
    Transition,
    UpdateMetrics,
)

__all__ = [
    "ACTION_SIZE",
    "ATTACKER",
    "DEFENDER",
    "GRU",
    "MLP",
    "NUM_SIDES",
    "OBSERVATION_SIZE",
    "SIDES",
    "Batch",
    "Cause",
    "Craft",
    "Drawn",
    "Drones",
    "Encoder",
    "EnvState",
    "FightRecord",
    "FightResult",
    "Flown",
    "IterationMetrics",
    "Learner",
    "Outcome",
    "Parameters",
    "Policy",
    "Pool",
    "RewardTerms",
    "Scaler",
    "SelfPlay",
    "SidePolicy",
    "StepOutput",
    "TeamPolicy",
    "TrainState",
    "Trajectory",
    "Transition",
    "UpdateMetrics",
]
