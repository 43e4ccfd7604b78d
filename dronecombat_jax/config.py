"""Every setting of the project: frozen dataclasses with a unit, a range and one line each.

What lives here: the fields, their defaults and their bounds; nothing imports JAX. What does not:
reading TOML, merging flags and reporting errors (`dronecombat_jax.settings`).

Each field is the switch of one line of the fidelity ledger (`docs/fidelity.md`).
"""

from dataclasses import dataclass, field
from typing import Any, Literal


def setting(
    default: Any,
    doc: str,
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    low_open: bool = False,
) -> Any:
    """A dataclass field with the metadata that validation, `--help` and the docs read.

    `low` and `high` are inclusive bounds (`low_open`: `low` itself is excluded).
    """
    return field(
        default=default,
        metadata={"doc": doc, "unit": unit, "low": low, "high": high, "low_open": low_open},
    )


@dataclass(frozen=True)
class SimConfig:
    """Flight: one rigid body per drone, stepped by MJX."""

    body: Literal["isaac", "firmware", "menagerie", "p250"] = setting(
        "isaac", "mass and inertia of both drones (isaac: the composite of Isaac's cf2x)"
    )
    mjcf: str = setting("", "MJCF of a drone or a scene of your own (docs/own_drone.md); empty: the package's")
    timestep: float = setting(0.01, "physics step", unit="s", low=1e-4, high=0.05)
    substeps: int = setting(2, "physics steps per control step", low=1, high=100)
    thrust_to_weight: float = setting(1.9, "full thrust over weight (eq. 7)", low=1.0, high=20.0, low_open=True)
    moment_scale: float = setting(
        0.01, "moment at full deflection about each body axis (eq. 8)", unit="N m", low=0.0, high=100.0
    )
    max_body_rate: float = setting(
        100.0, "cap on the norm of the body rate (PhysX's default)", unit="rad/s", low=1.0, high=1e4
    )
    gyroscopic: Literal["implicit", "explicit"] = setting(
        "implicit", "gyroscopic torque: backward Euler, or MuJoCo's explicit term (diverges when tumbling)"
    )


@dataclass(frozen=True)
class GameConfig:
    """Rules of the fight: start, events and what ends it."""

    scenario: Literal["duel", "solo"] = setting(
        "duel", "duel: both fight; solo: the attacker alone, the defender is absent"
    )
    spawn: Literal["fixed", "uniform"] = setting("fixed", "start positions: three points, or uniform in [-5, 5]^2")
    spawn_spread: float = setting(
        0.0,
        "fixed starts: half-width of the square around each point in which it is drawn",
        unit="m",
        low=0.0,
        high=5.0,
    )
    defender_spread: float = setting(
        0.0, "fixed starts: the same for the defender, where it shall be wider", unit="m", low=0.0, high=5.0
    )
    spawn_altitude_low: float = setting(0.5, "lowest start altitude", unit="m", low=0.0, high=100.0)
    spawn_altitude_high: float = setting(1.5, "highest start altitude", unit="m", low=0.0, high=100.0)
    episode_steps: int = setting(500, "control steps until time-out", low=1, high=100_000)
    intercept_radius: float = setting(
        0.5,
        "defender wins within this distance of the attacker (0.1: literal touch)",
        unit="m",
        low=0.0,
        high=5.0,
        low_open=True,
    )
    reach_radius: float = setting(
        0.5, "attacker wins within this distance of the target", unit="m", low=0.0, high=5.0, low_open=True
    )
    crash_altitude: float = setting(0.2, "a drone below this altitude has crashed", unit="m", low=0.0, high=10.0)
    swept_events: bool = setting(True, "test distances along the segment flown, not only at its end")
    crash_rule: Literal["ends", "out", "grounded"] = setting(
        "ends", "a crash: ends the fight; takes the drone out; leaves it lying and paying at every step"
    )
    timeout_rule: Literal["draw", "defender"] = setting(
        "draw", "who wins at time-out: nobody, or the defender (the attacker has failed)"
    )
    observation: Literal["world", "ego"] = setting(
        "world", "world: eq. 5 for both agents; ego: the same in the observing drone's own frame"
    )
    random_clock: bool = setting(True, "draw the episode clock uniformly at a run's first reset")


@dataclass(frozen=True)
class RewardConfig:
    """Weights of the reward terms (eq. 9-12). Each term is logged by name."""

    time_scaled: bool = setting(True, "multiply the dense terms by the control step (false: the literal form)")
    approach_weight: float = setting(50.0, "weight w of 1 - tanh(distance / c)", unit="1/s", low=0.0, high=1e4)
    defender_distance_scale: float = setting(5.0, "c1 of eq. 10", unit="m", low=0.0, high=1e3, low_open=True)
    attacker_distance_scale: float = setting(5.0, "c2 of eq. 12", unit="m", low=0.0, high=1e3, low_open=True)
    linear_velocity_penalty: float = setting(0.05, "per (m/s)^2", low=0.0, high=100.0)
    angular_velocity_penalty: float = setting(0.01, "per (rad/s)^2", low=0.0, high=100.0)
    win: float = setting(300.0, "for intercepting (defender) or reaching the target (attacker)", low=0.0, high=1e5)
    lose: float = setting(300.0, "paid by the defender when the target is reached", low=0.0, high=1e5)
    intercepted: float = setting(300.0, "paid by the attacker when it is intercepted", low=0.0, high=1e5)
    crash_penalty: float = setting(10.0, "paid by a drone that crashes", low=0.0, high=1e5)
    crash_win: float = setting(
        300.0,
        "for the other drone when one crashes (under crash_rule ends, and a downed attacker under out)",
        low=0.0,
        high=1e5,
    )
    timeout_win: float = setting(300.0, "for the defender at time-out, under timeout_rule defender", low=0.0, high=1e5)
    timeout_penalty: float = setting(
        300.0, "paid by the attacker at time-out, under timeout_rule defender", low=0.0, high=1e5
    )


@dataclass(frozen=True)
class LearnConfig:
    """IPPO: two independent PPO learners that share nothing (eq. 13-18)."""

    hidden_sizes: tuple[int, ...] = setting((256, 128), "hidden units of policy and value networks", low=1, high=8192)
    hidden_gain: float = setting(2.0**0.5, "gain of the orthogonal initialisation", low=0.0, high=10.0, low_open=True)
    policy_output_gain: float = setting(2.0**0.5, "gain of the policy's last layer", low=0.0, high=10.0)
    initial_log_std: float = setting(0.0, "log standard deviation of the actions at the start", low=-20.0, high=2.0)
    min_log_std: float = setting(-20.0, "lower bound of the log standard deviation", low=-20.0, high=2.0)
    max_log_std: float = setting(2.0, "upper bound of the log standard deviation", low=-20.0, high=10.0)
    clip_actions: bool = setting(False, "log-probability of the clipped action (the authors' setting; does not learn)")
    rollout_steps: int = setting(24, "control steps per environment and update", low=1, high=100_000)
    epochs: int = setting(5, "passes over a rollout", low=1, high=1000)
    minibatches: int = setting(6, "mini-batches per pass", low=1, high=100_000)
    minibatch_order: Literal["sequential", "shuffled"] = setting(
        "sequential", "contiguous and time-major as in skrl, or shuffled anew in every epoch"
    )
    discount: float = setting(0.99, "gamma", low=0.0, high=1.0)
    gae_lambda: float = setting(0.95, "lambda of the advantage estimate (eq. 15)", low=0.0, high=1.0)
    clip_ratio: float = setting(0.2, "clip of the probability ratio (eq. 14)", low=0.0, high=10.0, low_open=True)
    clip_value: float = setting(
        0.2, "clip of the value's change, normalised units (eq. 17)", low=0.0, high=1e6, low_open=True
    )
    value_loss: Literal["skrl", "ppo2_max", "paper_min", "plain"] = setting(
        "skrl", "which clipped value loss: skrl's, the larger of two, the smaller of two as printed, or unclipped"
    )
    value_loss_scale: float = setting(1.0, "lambda_critic of eq. 18", low=0.0, high=1e3)
    entropy_scale: float = setting(0.001, "lambda_entropy of eq. 18", low=0.0, high=10.0)
    max_grad_norm: float = setting(1.0, "joint global-norm clip over both networks", low=0.0, high=1e6, low_open=True)
    learning_rate: float = setting(3e-4, "Adam's learning rate at the start", low=0.0, high=1.0, low_open=True)
    learning_rate_schedule: Literal["kl", "constant"] = setting("kl", "KL-adaptive, or constant")
    kl_target: float = setting(0.008, "threshold of the KL-adaptive schedule", low=0.0, high=10.0, low_open=True)
    kl_factor: float = setting(
        2.0, "the rate moves when the KL leaves [target / factor, target * factor]", low=1.0, high=100.0, low_open=True
    )
    learning_rate_factor: float = setting(1.5, "by how much the rate moves", low=1.0, high=100.0, low_open=True)
    min_learning_rate: float = setting(1e-6, "lower bound of the schedule", low=0.0, high=1.0, low_open=True)
    max_learning_rate: float = setting(1e-2, "upper bound of the schedule", low=0.0, high=1.0, low_open=True)
    bootstrap_timeout: bool = setting(
        True, "a time-out is worth the value of its final observation (false: an end, as for the authors)"
    )
    inactive_steps: Literal["value", "none", "all"] = setting(
        "value",
        "who learns from the steps of a drone that is down, whose actions do nothing: the value function alone; "
        "nobody; policy, value and statistics, as if it flew",
    )
    normalize_observations: bool = setting(True, "running mean and variance of observations, clipped at 5")
    normalize_values: bool = setting(True, "running mean and variance of returns")


@dataclass(frozen=True)
class SelfPlayConfig:
    """Frozen past opponents (S-IPPO). IPPO is probability 0."""

    probability: float = setting(
        0.0,
        "chance that a chunk is fought against frozen past opponents (0: IPPO; the paper's S-IPPO: 0.2)",
        low=0.0,
        high=1.0,
    )
    roles: Literal["defender", "attacker", "both"] = setting(
        "defender", "who meets the past of the other: the defender (paper), the attacker, or in turn by lot both"
    )
    sampler: Literal["uniform", "latest", "delta_uniform", "pfsp_hard", "pfsp_variance"] = setting(
        "uniform", "how past opponents are drawn from the pool (selfplay.samplers)"
    )
    scope: Literal["chunk", "environment"] = setting(
        "chunk", "one past opponent for a whole chunk (paper), or one drawn for each environment"
    )
    delta: float = setting(
        0.5, "delta_uniform: how far back, as a share of the pool (0: the newest alone)", low=0.0, high=1.0
    )
    pfsp_power: float = setting(2.0, "pfsp_hard: exponent k of (1 - x)^k", low=0.0, high=100.0)
    memory: float = setting(
        0.5, "what a record of wins against a pool member is still worth one chunk later", low=0.0, high=1.0
    )
    restore_live: bool = setting(
        True, "the live player comes back after a frozen chunk (false: lost, as in the authors' script)"
    )


@dataclass(frozen=True)
class TrainConfig:
    """How much, how wide and from which seed."""

    total_steps: int = setting(20_000_000, "environment steps per seed, rounded up to whole chunks", low=1, high=10**12)
    num_envs: int = setting(1000, "environments side by side", low=1, high=10**6)
    chunk_iterations: int = setting(
        25,
        "iterations per chunk; at a chunk's end both agents are saved",
        low=1,
        high=100_000,
    )
    reset_at_chunk: bool = setting(
        False, "start all fights anew at every chunk; they then fly in step, which unsettles learning for a while"
    )
    head_start_steps: int = setting(
        0,
        "environment steps in which the attacker alone learns, against the untrained defender; whole chunks",
        low=0,
        high=10**12,
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
    seed: int = setting(0, "first seed", low=0, high=2**31 - 1)
    num_seeds: int = setting(1, "seeds trained side by side: seed, seed + 1, ...", low=1, high=1024)


@dataclass(frozen=True)
class RunConfig:
    """Where the run lives and what is made of it."""

    name: str = setting("", "name of the run (default: method-preset)")
    directory: str = setting("runs", "folder that holds all runs")
    device: Literal["auto", "cpu", "gpu", "tpu"] = setting("auto", "where to compute; asked for and absent is an error")
    devices: int = setting(
        0,
        "devices to train on, on a CPU its cores: first a share of the seeds for each, then, with more devices than "
        "seeds, of the environments (0: as many as divide the seeds)",
        low=0,
        high=1024,
    )
    seeds_at_once: int = setting(
        0, "seeds that a device trains side by side (0: on a CPU one after the other, elsewhere all)", low=0, high=10**6
    )
    distributed: bool = setting(False, "train in several processes on all their devices (docs/scaling.md)")
    join_seconds: float = setting(
        300.0, "how long a process waits for the others at the start", unit="s", low=1.0, high=86_400.0
    )
    matmul_precision: Literal["default", "tensorfloat32", "float32"] = setting(
        "default", "of matrix products on a GPU or TPU (default: JAX's choice; a CPU always computes in float32)"
    )
    keep: str = setting(
        "all",
        'checkpoints that stay: all; "every N", those of every N-th chunk; "last N". The newest two always stay. '
        "Tournaments play those that are there",
    )
    figures: bool = setting(True, "draw learning curves at the end")
    video: bool = setting(True, "render a picture and a short video of a fight at the end")
    replay: bool = setting(True, "write a page that replays fights in a browser at the end")
    evaluation_fights: int = setting(256, "fights of the evaluation at the end of training", low=1, high=10**6)


@dataclass(frozen=True)
class Config:
    """A whole run. Defaults < preset file < command-line flags."""

    sim: SimConfig = field(default_factory=SimConfig)
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
    def solo_envs(self) -> int:
        """Environments in which the attacker flies alone: the first ones."""
        return round(self.train.solo_share * self.train.num_envs)

    @property
    def num_chunks(self) -> int:
        """Chunks of the run: `total_steps` rounded up."""
        return -(-self.train.total_steps // self.steps_per_chunk)

    @property
    def head_start_chunks(self) -> int:
        """Chunks in which the attacker alone learns."""
        return -(-self.train.head_start_steps // self.steps_per_chunk)
