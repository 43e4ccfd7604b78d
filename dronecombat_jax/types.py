"""Every pytree that crosses a room's border, with its axes and units.

Axes, always in this order: S seeds, T time, N environments, A agents. Agents are drones: all
defenders, then all attackers (`GameConfig.sides`). There are always two sides, 0 the defender's and
1 the attacker's; learners, pools and tournaments have sides. Where each side has one drone, side
and agent are the same number. Lengths that depend on A are given for two drones.
What does not live here: settings (`config`) and anything that computes.
"""

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


class Encoder(struct.PyTreeNode):
    """One layer for the slots of others in observation `nearest`: G groups, team mates and opponents,
    each with weights of its own, which the slots of a group share.
    """

    weights: jax.Array  # [G, 9, E]
    biases: jax.Array  # [G, E]


class MLP(struct.PyTreeNode):
    """A multilayer perceptron: `weights[i]` is [in, out], `biases[i]` is [out]."""

    weights: tuple[jax.Array, ...]
    biases: tuple[jax.Array, ...]
    others: Encoder | None = None  # before the first layer; None: it sees the slots side by side


class GRU(struct.PyTreeNode):
    """A gated recurrent unit of H numbers; columns: reset, update, candidate (`learn.recurrent`)."""

    weights: jax.Array  # [in, 3 H]
    state_weights: jax.Array  # [H, 3 H]
    biases: jax.Array  # [3 H]
    candidate_bias: jax.Array  # [H], of the state's part of the candidate, behind the reset gate


class Parameters(struct.PyTreeNode):
    """What one agent learns; nothing is shared between agents or between the two networks."""

    policy: MLP  # observation -> mean of the action
    log_std: jax.Array  # [4]
    value: MLP  # observation, or the whole state -> normalised value
    gru: GRU | None = None  # observation -> what policy and value see beside it; None: nothing


class Scaler(struct.PyTreeNode):
    """Running mean and variance, as skrl's RunningStandardScaler."""

    mean: jax.Array  # [size]
    variance: jax.Array  # [size]
    count: jax.Array  # []


class Learner(struct.PyTreeNode):
    """One agent's whole learning state."""

    parameters: Parameters
    optimizer: Any  # optax state
    observation_scaler: Scaler  # [35]
    value_scaler: Scaler  # []
    learning_rate: jax.Array  # []
    critic_scaler: Scaler | None = None  # [37], of what a central critic sees; None: no such critic


class Transition(NamedTuple):
    """A rollout as collected; time-major."""

    observation: jax.Array  # [T, N, A, 35] before the step
    action: jax.Array  # [T, N, A, 4] as drawn, not clipped by the environment
    log_prob: jax.Array  # [T, N, A]
    reward: jax.Array  # [T, N, A]
    terminated: jax.Array  # [T, N] bool
    truncated: jax.Array  # [T, N] bool
    final_observation: jax.Array  # [T, N, A, 35] after the step, before any reset
    cause: jax.Array  # [T, N] int32
    clock: jax.Array  # [T, N] int32, control steps flown when the step was done
    # [T, N, A] bool, the drone was down after the step, and not by a strike
    down: jax.Array
    active: jax.Array  # [T, N, A] bool, as in `StepOutput`
    idle: jax.Array  # [T, N, A] bool
    reward_terms: RewardTerms  # each [T, N, A]
    # [T, N, A, 37], before and after the step, what a central critic sees; None: no such critic
    whole: jax.Array | None = None
    final_whole: jax.Array | None = None
    recall: jax.Array | None = None  # [T, N, A, M], what was remembered before the step


class Batch(NamedTuple):
    """One agent's rollout, ready to learn from; leading axes [T, N] or [B]."""

    observation: jax.Array  # [..., 35] normalised
    action: jax.Array  # [..., 4]
    log_prob: jax.Array  # [...]
    advantage: jax.Array  # [...] normalised over the whole rollout
    value: jax.Array  # [...] normalised, of the policy that collected
    target: jax.Array  # [...] normalised return
    weight: jax.Array  # [...] 1 where the policy learns from the step, else 0
    value_weight: jax.Array  # [...] 1 where the value function does
    whole: jax.Array | None = None  # [..., 37] normalised, what a central critic sees
    # Of policies with a GRU alone, whose batch is cut by environments; leading axes [T, N]:
    recall: jax.Array | None = None  # [..., M] what was remembered before the step
    fresh: jax.Array | None = None  # [...] bool, the step is a fight's first, but at the start


class UpdateMetrics(NamedTuple):
    """What one update of one agent reports, averaged over its gradient steps."""

    policy_loss: jax.Array
    value_loss: jax.Array
    entropy: jax.Array  # mean over action dimensions, nat
    kl: jax.Array  # of the last epoch
    clip_fraction: jax.Array
    grad_norm: jax.Array  # before the clip
    skipped: jax.Array  # gradient steps skipped because something was not finite
    learning_rate: jax.Array  # after the update
    explained_variance: jax.Array
    log_std: jax.Array  # mean over action dimensions
    active_share: jax.Array  # of the rollout's steps, those that the policy learnt from


class IterationMetrics(NamedTuple):
    """What one iteration reports; it counts fights that the same two flew from start to end."""

    causes: jax.Array  # [len(Cause)] counted fights that each `Cause` ended
    crashes: jax.Array  # [A] counted fights in which that drone had gone down
    episode_steps: jax.Array  # [] sum over counted fights, control steps
    returns: jax.Array  # [A] sum over counted fights of all their rewards
    diverged: jax.Array  # [] int32, fights whose simulation diverged, counted or not
    reward_terms: RewardTerms  # each [A], mean per step
    learners: UpdateMetrics  # each [A]
    frozen: jax.Array  # [] int32, the role that was played by its past; -1: none
    opponent: jax.Array  # [] mean slot of the past players met; -1: none
    # [R, 3] int32, counted fights by `Outcome` against each row of `selfplay.opponents`, the first
    # between live players; None where that setting is empty
    met: jax.Array | None = None


class Policy(struct.PyTreeNode):
    """What a drone needs to fly: the policy network and the scaler it was trained with."""

    network: MLP
    log_std: jax.Array  # [4]
    observation_scaler: Scaler  # [35]
    gru: GRU | None = None  # observation -> what the network sees beside it; None: nothing


class Pool(struct.PyTreeNode):
    """The past policies of one role: slot k holds the agent as it was when chunk k began."""

    policies: Policy  # each leaf [K, ...]; zeros where the chunk has not begun
    # [K] fights that the live learner won against this member, ties half; old ones fade
    wins: jax.Array
    games: jax.Array  # [K] fights against this member; old ones fade


class SelfPlay(struct.PyTreeNode):
    """Who is met in the present chunk, and who may be met later."""

    # by the role of the past player; None where its past is never played
    pools: tuple[Pool | None, Pool | None]
    frozen: jax.Array  # [] int32, the role that is played by its past in this chunk; -1: none
    # [N] int32, the slot that it is played from in each environment; -1: none; below -2: the row of
    # chunks that is met instead (`selfplay.pool.FIXED`)
    opponent: jax.Array


class Flown(struct.PyTreeNode):
    """What training knows of each fight under way (`selfplay.tally`)."""

    # [N] int32, control steps flown since its start; the clock may have begun later
    steps: jax.Array
    returns: jax.Array  # [N, A] rewards since its start
    # [N] int32, who has flown it: a code of `selfplay.pool.met`, or `selfplay.tally.MIXED`
    met: jax.Array


class TrainState(struct.PyTreeNode):
    """A whole training run between iterations; in a program each leaf has a leading axis S."""

    learners: Learner  # each leaf [A, ...]
    env: EnvState  # each leaf [N, ...]
    flown: Flown  # each leaf [N, ...]
    seed: jax.Array  # [] uint32
    iteration: jax.Array  # [] int32, iterations done
    selfplay: SelfPlay | None = None  # None: probability 0 (IPPO)


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
