"""The rotors and the air of each body in `sim.body`: numbers with their sources, no computation.

Sources, by the letters at the numbers:
F: bitcraze/crazyflie-firmware, src/platform/interface/platform_defaults_cf2.h and .._cf21bl.h:
   THRUST_MIN, THRUST_MAX (a motor), THRUST2TORQUE, ARM_LENGTH (to the rotor, 45 degrees off x), and
   the voltage at which the cubic VMOTOR2THRUST gives THRUST_MAX. src/config/config.h:
   BAT_LOADING_SAG_THRESHOLD, the most that a healthy battery may lose with all motors on.
R: rl-tools/rl-tools, rl/environments/l2f/parameters/dynamics/crazyflie.h: time constants of the
   rotor's speed, up and down. Eschmann, Albani, Loianno, arXiv 2404.07837, measured 0.072 s.
D: utiasDSL/drone-models, data/params.toml at 801738b (rotor_tau) and so_rpy_rotor_drag/params.toml
   at 7b9dba3 (drag_matrix). The drag of the two Crazyflies with brushes is marked unchecked there.
A: Agilicious' Kingfisher, parameters/quads/kingfisher.yaml (Foehn et al., Science Robotics 7, 2022);
   its drag is written there, and switched off.
C: our choice, no source: rates at full command and gains of the rate loop.
Sources differ by 30 times in the lag of one and the same motor: docs/how_to/real_drone.md.
"""

from dataclasses import asdict, dataclass
from typing import Any

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.sim.flown import BODIES


@dataclass(frozen=True)
class Rotors:
    """Four alike rotors; body x forwards, y to the left, z up. Without a `layout` they are an X."""

    arm_x: float  # m, each rotor's distance from the centre along x
    arm_y: float  # m, along y
    min_thrust: float  # N a motor, never less
    max_thrust: float  # N a motor
    torque_ratio: float  # m, moment about z per thrust
    lag_up: float  # s, first order in the rotor's speed, while it gains speed
    lag_down: float  # s, while it loses speed
    drag: tuple[float, float, float]  # N s/m along the body's axes, linear in the speed through air
    max_rates: tuple[float, float, float]  # rad/s at full command, of `ctbr`
    rate_gain: float  # 1/s, of the rate loop of `ctbr`
    full_voltage: float  # V at the motor for full thrust; 0: no battery is modelled
    battery_drop: float  # V with all motors at full thrust
    # [4][3] m, of rotors elsewhere: moments about x, y, z for each newton of each, about the
    # centre of mass; `arm_x`, `arm_y` are then means
    layout: tuple[tuple[float, ...], ...] | None = None


# Of the X: where each rotor is, in arms, and the sign of its moment about z. Rotor 1 is front
# right, then clockwise as seen from above; a rotor that turns clockwise turns the body the other
# way, which is positive.
PLACES = ((1, -1), (-1, -1), (-1, 1), (1, 1))
SENSES = (-1, 1, -1, 1)

_ARM = 0.046 / 2**0.5  # F
_DRAG = (0.0177, 0.0177, 0.0177)  # D
_CRAZYFLIE_RATES = (10.0, 10.0, 4.0)  # C

CRAZYFLIE = Rotors(
    arm_x=_ARM,
    arm_y=_ARM,
    min_thrust=0.02,  # F
    max_thrust=0.1125,  # F
    torque_ratio=0.005964552,  # F
    lag_up=0.0691,  # R
    lag_down=0.1137,  # R
    drag=_DRAG,
    max_rates=_CRAZYFLIE_RATES,
    rate_gain=20.0,  # C
    full_voltage=2.997,  # F
    battery_drop=0.7,  # F
)

ROTORS: dict[str, Rotors] = {
    # the paper's and other simulators' bodies fly the standard Crazyflie's rotors
    "isaac": CRAZYFLIE,
    "menagerie": CRAZYFLIE,
    "p250": CRAZYFLIE,
    # Crazyflie 2.1+ with its standard propellers
    "firmware": CRAZYFLIE,
    # Crazyflie 2.1 with the thrust upgrade kit
    "upgrade": Rotors(
        arm_x=_ARM,
        arm_y=_ARM,
        min_thrust=0.03,  # F
        max_thrust=0.1625,  # F
        torque_ratio=0.005964552,  # F, measured with the older propellers
        lag_up=0.0984,  # D
        lag_down=0.0984,  # D
        drag=_DRAG,
        max_rates=_CRAZYFLIE_RATES,
        rate_gain=20.0,  # C
        full_voltage=2.644,  # F
        battery_drop=0.7,  # F
    ),
    # Crazyflie 2.1 Brushless
    "brushless": Rotors(
        arm_x=0.050 / 2**0.5,  # F
        arm_y=0.050 / 2**0.5,  # F
        min_thrust=0.0214,  # F
        max_thrust=0.2,  # F
        torque_ratio=0.00569278844371417,  # F
        lag_up=0.0608,  # D
        lag_down=0.0608,  # D
        drag=(0.0215, 0.0215, 0.0236),  # D
        max_rates=_CRAZYFLIE_RATES,
        rate_gain=20.0,  # C
        full_voltage=3.126,  # F
        battery_drop=0.7,  # F
    ),
    # a racing quad of 0.75 kg
    "racer": Rotors(
        arm_x=0.075,  # A
        arm_y=0.10,  # A
        min_thrust=0.0352,  # A, thrust_map at motor_omega_min
        max_thrust=8.5,  # A
        torque_ratio=0.022,  # A
        lag_up=0.033,  # A
        lag_down=0.033,  # A
        drag=(0.26, 0.28, 0.42),  # A
        max_rates=(15.0, 15.0, 4.0),  # A
        rate_gain=20.0,  # C
        full_voltage=0.0,
        battery_drop=0.0,
    ),
}


def thrust_to_weight(body: str, gravity: float = 9.81) -> float:
    """Full thrust of the four rotors over the weight of `body`."""
    return 4.0 * ROTORS[body].max_thrust / (BODIES[body][0] * gravity)


def flies_rotors(sim: SimConfig) -> bool:
    """Whether a flight depends on the numbers in here."""
    return sim.actuation != "wrench" or sim.drag


def described(rotors: Rotors) -> dict[str, Any]:
    """Every number of the rotors by dotted key, plain JSON: for digests and policy cards."""
    spelt = lambda value: [spelt(item) for item in value] if isinstance(value, tuple) else value
    numbers = {f"rotors.{key}": spelt(value) for key, value in asdict(rotors).items()}
    return {key: value for key, value in numbers.items() if value is not None}
