"""Settings of the flight, the rules and the reward.

Each is the switch of one line of `docs/fidelity.md`.
"""

from dataclasses import dataclass
from typing import Literal

from dronecombat_jax.config.setting import setting
from dronecombat_jax.config.sides import MAX_TEAM, Sides, sides_of


@dataclass(frozen=True)
class SimConfig:
    """Flight: one rigid body per drone, stepped by MJX."""

    body: Literal["isaac", "firmware", "menagerie", "p250", "upgrade", "brushless", "racer"] = (
        setting(
            "isaac",
            "mass, inertia and rotors of both drones (docs/how_to/real_drone.md)",
            file=".toml",
        )
    )
    actuation: Literal["wrench", "rotors", "mixed", "ctbr"] = setting(
        "wrench",
        "what an action is: the paper's ideal thrust and moments; four rotors' thrusts; thrust and "
        "moments mixed to four rotors; collective thrust and body rates",
    )
    drag: bool = setting(False, "linear drag of the body in the air")
    gust_speed: float = setting(
        0.0, "gusts: deviation of each component of the wind", unit="m/s", low=0.0, high=20.0
    )
    gust_time: float = setting(
        1.0, "gusts: correlation time of the wind", unit="s", low=0.01, high=100.0
    )
    battery: float = setting(
        0.0,
        "a cell's voltage at rest, which drops under load and bounds thrust (4.2: full, 3.5: nearly "
        "empty); 0: an ideal battery",
        unit="V",
        low=0.0,
        high=4.35,
    )
    mjcf: str = setting(
        "", "MJCF of a drone or a scene of your own (docs/own_drone.md); empty: the package's"
    )
    timestep: float = setting(0.01, "physics step", unit="s", low=1e-4, high=0.05)
    substeps: int = setting(2, "physics steps per control step", low=1, high=100)
    thrust_to_weight: float = setting(
        1.9, "full thrust over weight (eq. 7)", low=1.0, high=20.0, low_open=True
    )
    moment_scale: float = setting(
        0.01,
        "moment at full deflection about each body axis (eq. 8)",
        unit="N m",
        low=0.0,
        high=100.0,
    )
    max_body_rate: float = setting(
        100.0, "cap on the norm of the body rate (PhysX's default)", unit="rad/s", low=1.0, high=1e4
    )
    gyroscopic: Literal["implicit", "explicit"] = setting(
        "implicit",
        "gyroscopic torque: backward Euler, or MuJoCo's explicit term (diverges when tumbling)",
    )


@dataclass(frozen=True)
class RandomiseConfig:
    """How far the drones of a fight may differ from the nominal body, as a share of its number.

    Drawn for each fight and side, uniformly on both sides of it. Commands keep the nominal scale.
    """

    mass: float = setting(0.0, "of the mass", low=0.0, high=0.9)
    inertia: float = setting(0.0, "of the inertia", low=0.0, high=0.9)
    thrust: float = setting(0.0, "of thrust and moments for a command", low=0.0, high=0.9)
    lag: float = setting(0.0, "of the rotors' lag", low=0.0, high=0.9)
    drag: float = setting(0.0, "of the drag", low=0.0, high=0.9)
    battery: float = setting(0.0, "of the battery's voltage at rest", low=0.0, high=0.9)


@dataclass(frozen=True)
class DroneConfig:
    """How the drones of one side differ from the nominal body, in every fight: factors.

    Commands keep the nominal scale. What `randomise` draws lies around them.
    """

    mass: float = setting(1.0, "mass over the nominal one", low=0.1, high=10.0)
    inertia: float = setting(1.0, "inertia over the nominal one", low=0.1, high=10.0)
    thrust: float = setting(
        1.0, "thrust and moments for a command over the nominal ones", low=0.0, high=10.0
    )
    lag: float = setting(1.0, "the rotors' lag over the nominal one", low=0.001, high=100.0)
    drag: float = setting(1.0, "drag over the nominal one", low=0.0, high=100.0)
    battery: float = setting(
        1.0, "the battery's voltage at rest over the nominal one", low=0.1, high=2.0
    )


@dataclass(frozen=True)
class SensorConfig:
    """What policies observe of both drones; each side has errors of its own, of a normal law.

    Range, field of view and drop-out hide the other drone: its numbers are then 0.
    """

    side: Literal["both", "defender", "attacker"] = setting(
        "both", "whose policies observe so; the others observe the state itself"
    )

    position_noise: float = setting(
        0.0, "deviation of each coordinate", unit="m", low=0.0, high=1.0
    )
    attitude_noise: float = setting(
        0.0, "deviation of the attitude about each body axis", unit="rad", low=0.0, high=0.5
    )
    velocity_noise: float = setting(
        0.0, "deviation of each velocity", unit="m/s", low=0.0, high=5.0
    )
    rate_noise: float = setting(0.0, "deviation of each body rate", unit="rad/s", low=0.0, high=5.0)
    bias: float = setting(
        0.0,
        "constant error of each fight; its deviation is this times those above",
        low=0.0,
        high=10.0,
    )
    latency: int = setting(0, "control steps before a measurement arrives", low=0, high=50)
    period: int = setting(1, "control steps from one measurement to the next", low=1, high=50)
    range: float = setting(
        0.0, "farther away another drone is not seen; 0: however far", unit="m", low=0.0, high=1e3
    )
    field_of_view: float = setting(
        360.0,
        "full angle about the body's x axis in which another drone is seen; 360: all round",
        unit="degrees",
        low=0.0,
        high=360.0,
        low_open=True,
    )
    dropout: float = setting(
        0.0, "share of the measurements in which another drone is not seen", low=0.0, high=1.0
    )


@dataclass(frozen=True)
class GameConfig:
    """Rules of the fight: start, events and what ends it."""

    scenario: Literal["duel", "solo"] = setting(
        "duel", "duel: both fight; solo: the attacker alone, the defender is absent", own=True
    )
    defenders: int = setting(
        1, "drones on the defender's side (docs/concepts/teams.md)", low=1, high=MAX_TEAM
    )
    attackers: int = setting(1, "drones on the attacker's side", low=1, high=MAX_TEAM)
    team_spacing: float = setting(
        0.5,
        "the least distance along x at which team mates start",
        unit="m",
        low=0.0,
        high=5.0,
    )
    striker_down: bool = setting(
        False, "teams: a defender that takes an attacker out goes down with it"
    )
    spawn: Literal["fixed", "uniform"] = setting(
        "fixed", "start positions: three points, or uniform in [-5, 5]^2"
    )
    spawn_spread: float = setting(
        0.0,
        "fixed starts: half-width of the square around each point in which it is drawn",
        unit="m",
        low=0.0,
        high=5.0,
    )
    defender_spread: float = setting(
        0.0,
        "fixed starts: the same for the defender, where it shall be wider",
        unit="m",
        low=0.0,
        high=5.0,
    )
    defender_setback: float = setting(
        0.0,
        "fixed starts: how much farther from the target the defender starts, along -x",
        unit="m",
        low=0.0,
        high=20.0,
    )
    spawn_altitude_low: float = setting(0.5, "lowest start altitude", unit="m", low=0.0, high=100.0)
    spawn_altitude_high: float = setting(
        1.5, "highest start altitude", unit="m", low=0.0, high=100.0
    )
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
        0.5,
        "attacker wins within this distance of the target",
        unit="m",
        low=0.0,
        high=5.0,
        low_open=True,
    )
    crash_altitude: float = setting(
        0.2, "a drone below this altitude has crashed", unit="m", low=0.0, high=10.0
    )
    swept_events: bool = setting(
        True, "test distances along the segment flown, not only at its end"
    )
    crash_rule: Literal["ends", "out", "grounded"] = setting(
        "ends",
        "a crash: ends the fight; takes the drone out; leaves it lying and paying at every step",
    )
    timeout_rule: Literal["draw", "defender"] = setting(
        "draw", "who wins at time-out: nobody, or the defender (the attacker has failed)"
    )
    observation: Literal["world", "ego", "engagement", "tracks", "bearing", "nearest"] = setting(
        "world",
        "world: eq. 5 for both agents; ego: the same in the observing drone's own frame; engagement: "
        "ego, and lines of sight and closest approaches; tracks: the same without the others' attitude; "
        "bearing: of the other drone its direction alone, as a camera gives; nearest: the nearest team "
        "mates and opponents, in the own frame",
        own=True,
    )
    nearest_k: int = setting(
        2, "observation nearest: slots for team mates and for opponents, each", low=1, high=8
    )
    random_clock: bool = setting(True, "draw the episode clock uniformly at a run's first reset")

    @property
    def sides(self) -> Sides:
        """The side of each drone, in the order of all arrays: defenders, then attackers."""
        return sides_of(self.defenders, self.attackers)


@dataclass(frozen=True)
class RewardConfig:
    """Weights of the reward terms (eq. 9-12). Each term is logged by name."""

    time_scaled: bool = setting(
        True, "multiply the dense terms by the control step (false: the literal form)"
    )
    approach_weight: float = setting(
        50.0, "weight w of 1 - tanh(distance / c)", unit="1/s", low=0.0, high=1e4
    )
    defender_distance_scale: float = setting(
        5.0, "c1 of eq. 10", unit="m", low=0.0, high=1e3, low_open=True
    )
    attacker_distance_scale: float = setting(
        5.0, "c2 of eq. 12", unit="m", low=0.0, high=1e3, low_open=True
    )
    linear_velocity_penalty: float = setting(0.05, "per (m/s)^2", low=0.0, high=100.0)
    angular_velocity_penalty: float = setting(0.01, "per (rad/s)^2", low=0.0, high=100.0)
    win: float = setting(
        300.0, "for intercepting (defender) or reaching the target (attacker)", low=0.0, high=1e5
    )
    lose: float = setting(
        300.0, "paid by the defender when the target is reached", low=0.0, high=1e5
    )
    intercepted: float = setting(
        300.0, "paid by the attacker when it is intercepted", low=0.0, high=1e5
    )
    team_share: float = setting(
        0.5,
        "teams: what a team mate's strike (its being struck) counts for a drone, over its own",
        low=0.0,
        high=1.0,
    )
    crash_penalty: float = setting(10.0, "paid by a drone that crashes", low=0.0, high=1e5)
    crash_win: float = setting(
        300.0,
        "for the other drone when one crashes (under crash_rule ends, and a downed attacker under out)",
        low=0.0,
        high=1e5,
    )
    timeout_win: float = setting(
        300.0, "for the defender at time-out, under timeout_rule defender", low=0.0, high=1e5
    )
    timeout_penalty: float = setting(
        300.0, "paid by the attacker at time-out, under timeout_rule defender", low=0.0, high=1e5
    )
