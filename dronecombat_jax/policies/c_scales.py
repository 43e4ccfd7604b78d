"""What a controller on a drone must know of a policy, as C constants: who flies, what it sees, and
what an action of 1 is in SI units.

Commands are scaled by the nominal body, as in training. What does not live here: the policy itself
(`c_header`).
"""

from collections.abc import Iterator

from dronecombat_jax.policies.info import ACTION_FIELDS, PolicyInfo
from dronecombat_jax.types import OBSERVATION_SIZE, SIDES


def scales(info: PolicyInfo) -> Iterator[str]:
    """One line of C for each constant."""
    met, kinds = info.environment, list(ACTION_FIELDS)
    yield f"#define DRONECOMBAT_ROLE {SIDES.index(info.role)} /* 0: defender, 1: attacker */"
    layout = int(info.observation == "world" and info.layer_sizes[0] == OBSERVATION_SIZE)
    yield f"#define DRONECOMBAT_WORLD {layout} /* whether it sees eq. 5: `world`, one drone a side */"
    for number, kind in enumerate(kinds):
        yield f"#define DRONECOMBAT_{kind.upper()} {number}"
    yield f"#define DRONECOMBAT_ACTUATION DRONECOMBAT_{info.actuation.upper()}"
    if info.actuation in ("wrench", "mixed"):
        thrust, moment = _full_thrust(info), float(met["sim.moment_scale"])
        yield f"#define DRONECOMBAT_FULL_THRUST {thrust!r}f /* N, of all rotors at 1; 0 at -1 */"
        yield f"#define DRONECOMBAT_FULL_MOMENT {moment!r}f /* N m about each body axis at 1 */"
        return
    yield f"#define DRONECOMBAT_MIN_THRUST {met['rotors.min_thrust']!r}f /* N a rotor at -1 */"
    yield f"#define DRONECOMBAT_MAX_THRUST {met['rotors.max_thrust']!r}f /* N a rotor at 1 */"
    if info.actuation == "ctbr":
        for axis, rate in zip("XYZ", met["rotors.max_rates"], strict=True):
            yield f"#define DRONECOMBAT_MAX_RATE_{axis} {rate!r}f /* rad/s at 1 */"


def _full_thrust(info: PolicyInfo) -> float:
    """N: eq. 7 of the nominal body."""
    from dronecombat_jax.sim.flown import BODIES  # MuJoCo, which a policy file can do without

    met = info.environment
    own = f"scene.{info.role}.mass"
    mass = met[own] if own in met else BODIES[met["sim.body"]][0]
    return float(met["sim.thrust_to_weight"] * mass * met.get("scene.gravity", 9.81))
