"""Every pytree of learning and self-play."""

from typing import Any, NamedTuple, TypeAlias

import jax
from flax import struct

from dronecombat_jax.types.fights import EnvState, RewardTerms


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
    progress: jax.Array | None = None  # [T, N, A] beside the reward; None: nothing
    # [T, N, A, 4] what the teachers would have done; 0 for drones without one, None: nobody has one
    lesson: jax.Array | None = None


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
    lesson: jax.Array | None = None  # [..., 4] what its teacher would have done; None: no teacher


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
    learners: UpdateMetrics  # each [L]
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


class TeamPolicy(struct.PyTreeNode):
    """The policies of a side whose drones each learnt their own (`learn.mates`); any leading axes."""

    mates: tuple[Policy, ...]  # in the order of its drones, at least two


SidePolicy: TypeAlias = Policy | TeamPolicy  # of all its drones, or of each


class Pool(struct.PyTreeNode):
    """The past policies of one role: slot k holds the side as it was when chunk k began."""

    policies: SidePolicy  # each leaf [K, ...]; zeros where the chunk has not begun
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

    learners: Learner  # each leaf [L, ...]
    env: EnvState  # each leaf [N, ...]
    flown: Flown  # each leaf [N, ...]
    seed: jax.Array  # [] uint32
    iteration: jax.Array  # [] int32, iterations done
    selfplay: SelfPlay | None = None  # None: probability 0 (IPPO)
    # each leaf [L, ...], mean of the policies in `learn.average_share` so far; None: nothing is averaged
    mean: Policy | None = None
