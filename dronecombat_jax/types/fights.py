"""Sides and endings by number, and every pytree of a fight."""

from enum import IntEnum
from typing import Any, NamedTuple

import jax
from flax import struct

DEFENDER = 0
ATTACKER = 1
SIDES = ("defender", "attacker")  # who learns, rates and wins
NUM_SIDES = len(SIDES)
ACTION_SIZE = 4
OBSERVATION_SIZE = 35


class Cause(IntEnum):
    """Why a fight ended. Of simultaneous events DIVERGED comes first, then invalid actions, then
    the others in order.

    The numbers are stored in files: new causes go to the end.
    """

    NONE = 0
    INTERCEPT = 1
    REACHED = 2
    DEFENDER_CRASH = 3
    ATTACKER_CRASH = 4
    BOTH_CRASH = 5
    TIMEOUT = 6
    DIVERGED = 7
    DEFENDER_INVALID = 8  # its action was not finite
    ATTACKER_INVALID = 9
    BOTH_INVALID = 10


class Outcome(IntEnum):
    """Who won a fight. The names are keys in files."""

    DEFENDER = 0
    DRAW = 1  # a tie: nobody won
    ATTACKER = 2


class Drones(NamedTuple):
    """Both drones' rigid-body states as MuJoCo's free joints hold them."""

    position: jax.Array  # [..., A, 3] m, world frame
    quaternion: jax.Array  # [..., A, 4] wxyz, body to world
    velocity: jax.Array  # [..., A, 3] m/s, WORLD frame
    rate: jax.Array  # [..., A, 3] rad/s, BODY frame


class Drawn(struct.PyTreeNode):
    """How a fight's drones differ from the nominal body: factors [A], 1 where they do not."""

    mass: jax.Array
    inertia: jax.Array
    thrust: jax.Array  # thrust and moments for a command
    lag: jax.Array
    drag: jax.Array
    battery: jax.Array


class Craft(struct.PyTreeNode):
    """What drones of a fight have beyond rigid bodies; None where a game is flown without it."""

    speeds: jax.Array | None = None  # [A, 4] of the rotors, over that of full thrust
    drawn: Drawn | None = None
    wind: jax.Array | None = None  # [3] m/s, world frame
    word: jax.Array | None = None  # [] uint32, what this fight's gusts and noise are hashed from
    memory: jax.Array | None = None  # [K, 26] past qpos and qvel, newest first


class EnvState(struct.PyTreeNode):
    """One fight. All that a scan has to carry: 31 floats, a clock and two flags."""

    qpos: jax.Array  # [14] m and wxyz: defender 0:7, attacker 7:14
    qvel: jax.Array  # [12] m/s in the world frame, rad/s in the body frame
    target: jax.Array  # [3] m
    clock: jax.Array  # [] int32, control steps since the start
    down: jax.Array  # [A] bool, the drone is down (or absent) and lies where it is
    craft: Craft | None = None  # None: ideal rigid bodies
    # [A] bool, the drone is down by a strike, not a crash; None in a duel, which a strike ends
    struck: jax.Array | None = None
    # [A, M] what each drone's policy remembers of the fight (`learn.memory`); None: nothing
    recall: jax.Array | None = None

    @property
    def crashed(self) -> jax.Array:
        """Who is down (or absent) and was not struck, [A] bool."""
        return self.down if self.struck is None else self.down & ~self.struck


class StepOutput(NamedTuple):
    """What one control step of one fight yields."""

    # [A, 35] after the step, before any reset: the final one where the fight ended
    observation: jax.Array
    reward: jax.Array  # [A]
    reward_terms: "RewardTerms"  # each [A], already weighted; they add up to the reward
    cause: jax.Array  # [] int32, a `Cause`; NONE while the fight goes on
    terminated: jax.Array  # [] bool, the fight was decided
    truncated: jax.Array  # [] bool, time ran out on an undecided fight
    # [A] bool, the drone flew, and its action had an effect: it was finite, and the physics held
    active: jax.Array
    # [A] bool, the drone was down before the step: its action had none, and the fight went on
    idle: jax.Array


class RewardTerms(NamedTuple):
    """The addends of eq. 9 and 11, weighted and signed, each [A]."""

    approach: jax.Array
    linear_velocity: jax.Array
    angular_velocity: jax.Array
    win: jax.Array
    lose: jax.Array
    crash: jax.Array
    timeout: jax.Array


class FightResult(NamedTuple):
    """How E fights ended."""

    cause: jax.Array  # [E] int32, a `Cause`
    steps: jax.Array  # [E] int32, control steps flown
    down: jax.Array  # [E, A] bool, the drone had crashed by the end


class FightRecord(NamedTuple):
    """E fights, step by step; after a fight's end its last state repeats."""

    qpos: jax.Array  # [T, E, 14] after the step
    qvel: jax.Array  # [T, E, 12]
    action: jax.Array  # [T, E, A, 4] clipped, as flown
    start: EnvState  # leaves [E, ...]
    result: FightResult
    # [T, E, A] bool after the step, as in `EnvState`; None in a duel, which its states tell whole
    down: jax.Array | None = None
    struck: jax.Array | None = None


class Trajectory(NamedTuple):
    """One fight, for pictures and replays (NumPy arrays)."""

    time: Any  # [T] s
    qpos: Any  # [T, 14]
    qvel: Any  # [T, 12]
    action: Any  # [T, A, 4] as flown, in [-1, 1]
    target: Any  # [3] m
    cause: int
    control_dt: float  # s
    # by setting of `randomise`, [A] each: the drones' drawn numbers over the nominal ones
    drawn: Any = None
    sides: tuple[int, ...] = (DEFENDER, ATTACKER)  # of each drone
    # [T, A] bool, as in `EnvState`; None in a duel
    down: Any = None
    struck: Any = None
