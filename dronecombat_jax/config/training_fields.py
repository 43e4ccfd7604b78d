"""Settings of learning, self-play, the amount of training and the run.

Each is the switch of one line of `docs/fidelity.md`.
"""

from dataclasses import dataclass
from typing import Literal

from dronecombat_jax.config.setting import setting


@dataclass(frozen=True)
class LearnConfig:
    """IPPO: two independent PPO learners that share nothing (eq. 13-18)."""

    algorithm: Literal["ppo"] = setting("ppo", "how each side learns (learn.algorithms)", own=True)
    critic: Literal["own", "central"] = setting(
        "own",
        "what the value function sees: what its policy does; or the whole state and who it is "
        "(MAPPO); the policy flies by its observation either way",
    )
    mates: Literal["shared", "own"] = setting(
        "shared",
        "team mates learn one policy together; or each its own, with its own value function, optimiser and statistics",
    )
    memory: Literal["none", "frames", "gru"] = setting(
        "none",
        "what a policy remembers of its fight: nothing; its last observations (frames); or the state "
        "of a gated recurrent unit (gru)",
    )
    memory_size: int = setting(64, "memory gru: numbers of its state", low=1, high=1024)
    frames: int = setting(
        4,
        "memory frames: observations that a network sees, the present one included",
        low=2,
        high=64,
    )
    others: Literal["flat", "mean"] = setting(
        "flat",
        "what networks make of the slots of observation nearest: numbers as any; or the mean of one "
        "layer over those who are seen, so that a policy flies in every size of team",
    )
    others_size: int = setting(32, "units of that layer", low=1, high=1024)
    hidden_sizes: tuple[int, ...] = setting(
        (256, 128), "hidden units of policy and value networks", low=1, high=8192
    )
    hidden_gain: float = setting(
        2.0**0.5, "gain of the orthogonal initialisation", low=0.0, high=10.0, low_open=True
    )
    policy_output_gain: float = setting(
        2.0**0.5, "gain of the policy's last layer", low=0.0, high=10.0
    )
    initial_log_std: float = setting(
        0.0, "log standard deviation of the actions at the start", low=-20.0, high=2.0
    )
    min_log_std: float = setting(
        -20.0, "lower bound of the log standard deviation", low=-20.0, high=2.0
    )
    max_log_std: float = setting(
        2.0, "upper bound of the log standard deviation", low=-20.0, high=10.0
    )
    clip_actions: bool = setting(
        False, "log-probability of the clipped action (the authors' setting; does not learn)"
    )
    rollout_steps: int = setting(
        24, "control steps per environment and update", low=1, high=100_000
    )
    epochs: int = setting(5, "passes over a rollout", low=1, high=1000)
    minibatches: int = setting(6, "mini-batches per pass", low=1, high=100_000)
    minibatch_order: Literal["sequential", "shuffled"] = setting(
        "sequential", "contiguous and time-major as in skrl, or shuffled anew in every epoch"
    )
    discount: float = setting(0.99, "gamma", low=0.0, high=1.0)
    gae_lambda: float = setting(
        0.95, "lambda of the advantage estimate (eq. 15)", low=0.0, high=1.0
    )
    clip_ratio: float = setting(
        0.2, "clip of the probability ratio (eq. 14)", low=0.0, high=10.0, low_open=True
    )
    clip_value: float = setting(
        0.2,
        "clip of the value's change, normalised units (eq. 17)",
        low=0.0,
        high=1e6,
        low_open=True,
    )
    value_loss: Literal["skrl", "ppo2_max", "paper_min", "plain"] = setting(
        "skrl",
        "which clipped value loss: skrl's, the larger of two, the smaller of two as printed, or unclipped",
    )
    value_loss_scale: float = setting(1.0, "lambda_critic of eq. 18", low=0.0, high=1e3)
    entropy_scale: float = setting(0.001, "lambda_entropy of eq. 18", low=0.0, high=10.0)
    max_grad_norm: float = setting(
        1.0, "joint global-norm clip over both networks", low=0.0, high=1e6, low_open=True
    )
    learning_rate: float = setting(
        3e-4, "Adam's learning rate at the start", low=0.0, high=1.0, low_open=True
    )
    learning_rate_schedule: Literal["kl", "constant"] = setting("kl", "KL-adaptive, or constant")
    kl_target: float = setting(
        0.008, "threshold of the KL-adaptive schedule", low=0.0, high=10.0, low_open=True
    )
    kl_factor: float = setting(
        2.0,
        "the rate moves when the KL leaves [target / factor, target * factor]",
        low=1.0,
        high=100.0,
        low_open=True,
    )
    learning_rate_factor: float = setting(
        1.5, "by how much the rate moves", low=1.0, high=100.0, low_open=True
    )
    min_learning_rate: float = setting(
        1e-6, "lower bound of the schedule", low=0.0, high=1.0, low_open=True
    )
    max_learning_rate: float = setting(
        1e-2, "upper bound of the schedule", low=0.0, high=1.0, low_open=True
    )
    bootstrap_timeout: bool = setting(
        True,
        "a time-out is worth the value of its final observation (false: an end, as for the authors)",
    )
    inactive_steps: Literal["value", "none", "all"] = setting(
        "value",
        "who learns from the steps of a drone that is down, whose actions do nothing: the value function alone; "
        "nobody; policy, value and statistics, as if it flew",
    )
    normalize_observations: bool = setting(
        True, "running mean and variance of observations, clipped at 5"
    )
    normalize_values: bool = setting(True, "running mean and variance of returns")
    defender_progress: float = setting(
        0.0,
        "in learning alone: reward per metre by which a defender's way to the attacker, or to defender_post, shrinks",
        unit="1/m",
        low=0.0,
        high=1e3,
    )
    defender_post: float = setting(
        0.0,
        "where defender_progress draws a defender: so far before the target, towards the attacker; 0: to the attacker",
        unit="m",
        low=0.0,
        high=20.0,
    )
    attacker_progress: float = setting(
        0.0,
        "in learning alone: reward per metre by which an attacker's way to the target shrinks",
        unit="1/m",
        low=0.0,
        high=1e3,
    )
    defender_teacher: str = setting(
        "",
        "a scripted defender that the defender's policy is drawn to by teacher_scale, such as goalkeeper; empty: nobody",
    )
    attacker_teacher: str = setting(
        "", "a scripted attacker that the attacker's policy is drawn to; empty: nobody"
    )
    teacher_scale: float = setting(
        1.0,
        "of the loss by which a policy is drawn to its teacher: half the squared distance of their mean actions",
        low=0.0,
        high=1e3,
    )
    settle_share: float = setting(
        0.0,
        "the training's last share, over which the policies settle: max_learning_rate falls to a hundredth, min_log_std to settled_log_std",
        low=0.0,
        high=1.0,
    )
    settled_log_std: float = setting(
        -2.0,
        "lower bound of the log standard deviation at the end of settle_share",
        low=-20.0,
        high=2.0,
    )
    average_share: float = setting(
        0.0,
        "the training's last share, whose policies are averaged, weight by weight: their mean is the final policy (0: the last one)",
        low=0.0,
        high=1.0,
    )

    @property
    def teachers(self) -> tuple[str, str]:
        """The scripted pilot that each side's policy is drawn to; "": nobody."""
        return self.defender_teacher, self.attacker_teacher

    @property
    def least_log_std(self) -> float:
        """The lowest bound of the log standard deviation at any time of the training."""
        settled = self.settled_log_std if self.settle_share > 0.0 else self.min_log_std
        return min(self.min_log_std, settled)


@dataclass(frozen=True)
class SelfPlayConfig:
    """Frozen past opponents (S-IPPO). IPPO is probability 0."""

    probability: float = setting(
        0.0,
        "chance that a chunk is fought against frozen past opponents (0: IPPO; the paper's S-IPPO: 0.2)",
        low=0.0,
        high=1.0,
    )
    opponents: str = setting(
        "",
        "who sits in a side's place, and in what share of the environments: SIDE=WHO SHARE, ...; WHO is past, "
        "past:SAMPLER, scripted:NAME, pilots:NAME, a policy file, RUN, RUN:CHUNK or (defender) nobody. "
        "SHARE 'of chunks' draws for whole chunks; one row without a share takes all that is left",
    )
    roles: Literal["defender", "attacker", "both"] = setting(
        "defender",
        "who meets past players of the other side: the defender (paper), the attacker, or either, by lot",
    )
    sampler: Literal[
        "uniform", "latest", "delta_uniform", "pfsp_hard", "pfsp_variance", "latest_and_hard"
    ] = setting(
        "uniform", "how past opponents are drawn from the pool (selfplay.samplers)", own=True
    )
    record: Literal["win", "rho", "margin"] = setting(
        "win",
        "what a fight of t out of T steps counts in the record that samplers see: win: won 1, tied 1/2; rho: how soon, "
        "1 - t/T where won, else 0; margin: (1 + rho)/2 won, 1/2 tied, (1 - rho)/2 lost",
    )
    scope: Literal["chunk", "environment"] = setting(
        "chunk", "one past opponent for a whole chunk (paper), or one drawn for each environment"
    )
    delta: float = setting(
        0.5,
        "delta_uniform: how far back, as a share of the pool (0: the newest alone)",
        low=0.0,
        high=1.0,
    )
    pfsp_power: float = setting(
        2.0, "pfsp_hard, latest_and_hard: exponent k of (1 - x)^k", low=0.0, high=100.0
    )
    memory: float = setting(
        0.5,
        "what a record of wins against a pool member is still worth one chunk later",
        low=0.0,
        high=1.0,
    )
    restore_live: bool = setting(
        True,
        "the live player comes back after a frozen chunk (false: lost, as in the authors' script)",
    )


@dataclass(frozen=True)
class TrainConfig:
    """How much, how wide and from which seed."""

    total_steps: int = setting(
        20_000_000, "environment steps per seed, rounded up to whole chunks", low=1, high=10**12
    )
    num_envs: int = setting(1000, "environments side by side", low=1, high=10**6)
    chunk_iterations: int = setting(
        25,
        "iterations per chunk; at a chunk's end both agents are saved",
        low=1,
        high=100_000,
    )
    reset_at_chunk: bool = setting(
        False,
        "start all fights anew at every chunk; they then fly in step, which unsettles learning for a while",
    )
    head_start_steps: int = setting(
        0,
        "environment steps in which the attacker alone learns, against the untrained defender; whole chunks",
        low=0,
        high=10**12,
    )
    lead_limit: float = setting(
        1.0,
        "a side that wins more than this share of an iteration's fights does not learn from it, while the other side does (1: it always learns)",
        low=0.5,
        high=1.0,
    )
    solo_share: float = setting(
        0.0,
        "share of the environments in which the attacker flies alone; they teach the attacker only, and are not counted",
        low=0.0,
        high=0.9,
    )
    start_speed: float = setting(
        0.0,
        "exploring starts: in training alone, both drones start with up to this speed along x and along y",
        unit="m/s",
        low=0.0,
        high=20.0,
    )
    start_anywhere: float = setting(
        0.0,
        "share of the training's fights in which every drone starts anywhere in the arena, up to 5 m high, and moves in any direction with up to start_speed along each axis",
        low=0.0,
        high=1.0,
    )
    start_at_rest: float = setting(
        0.0,
        "share of the training's fights that start at rest all the same, as those that count do",
        low=0.0,
        high=1.0,
    )
    strike_margin: float = setting(
        0.0,
        "where the defender alone learns, the intercept radius is so much smaller in training: it learns to come nearer than it must",
        unit="m",
        low=0.0,
        high=10.0,
    )
    seed: int = setting(0, "first seed", low=0, high=2**31 - 1)
    num_seeds: int = setting(1, "seeds trained side by side: seed, seed + 1, ...", low=1, high=1024)


@dataclass(frozen=True)
class RunConfig:
    """Where the run lives and what is made of it."""

    name: str = setting("", "name of the run (default: method-preset)")
    directory: str = setting("runs", "folder that holds all runs")
    device: Literal["auto", "cpu", "gpu", "tpu"] = setting(
        "auto", "where to compute; a device that is named and absent is an error"
    )
    devices: int = setting(
        0,
        "devices to train on, on a CPU its cores: first a share of the seeds for each, then, with more devices than "
        "seeds, of the environments (0: as many as divide the seeds)",
        low=0,
        high=1024,
    )
    seeds_at_once: int = setting(
        0,
        "seeds that a device trains side by side (0: on a CPU one after the other, elsewhere all)",
        low=0,
        high=10**6,
    )
    distributed: bool = setting(
        False, "train in several processes on all their devices (docs/scaling.md)"
    )
    join_seconds: float = setting(
        300.0,
        "how long a process waits for the others at the start",
        unit="s",
        low=1.0,
        high=86_400.0,
    )
    matmul_precision: Literal["default", "tensorfloat32", "float32"] = setting(
        "default",
        "of matrix products on a GPU or TPU (default: JAX's choice; a CPU always computes in float32)",
    )
    keep: str = setting(
        "all",
        'checkpoints that stay: all; "every N", those of every N-th chunk; "last N". The newest two always stay. '
        "Tournaments play those that are there",
    )
    figures: bool = setting(True, "draw learning curves at the end")
    video: bool = setting(True, "render a picture and a short video of a fight at the end")
    replay: bool = setting(True, "write a page that replays fights in a browser at the end")
    evaluation_fights: int = setting(
        256, "fights of the evaluation at the end of training", low=1, high=10**6
    )
    wandb: Literal["off", "offline", "online"] = setting(
        "off",
        "also send the metrics to Weights & Biases; offline: keep them in the run's folder for "
        "`wandb sync` (extra wandb)",
    )
