"""The controller for the Crazyflie firmware, compiled against declarations of its interface: units,
frames, order, and when it hands over to the stock controller.
"""

import shutil
import struct
import subprocess
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from policies import make_info, make_policy
from scipy.spatial.transform import Rotation

from dronecombat_jax.combat.observe import observe_world
from dronecombat_jax.config.fields import Config, SimConfig
from dronecombat_jax.policies.c_header import header_of
from dronecombat_jax.policies.file import save_policy
from dronecombat_jax.policies.numpy_policy import NumpyPolicy
from dronecombat_jax.sim.rotors import ROTORS
from dronecombat_jax.types import SIDES, Drones

ROOT = Path(__file__).parents[2]
STRICT = ("-std=gnu11", "-Wall", "-Wextra", "-Werror", "-O1")
SIZES = (35, 16, 8, 4)
TARGET = (1.5, -1.2, 1.0)
OWN = {"position": (0.5, -0.4, 1.1), "velocity": (0.3, -1.0, 0.4), "rate": (0.6, -0.8, 0.3)}
OTHER = {"position": (-0.7, 0.9, 1.3), "velocity": (1.2, 0.5, -0.2), "rate": (-1.5, 0.25, 2.0)}
TURNS = Rotation.from_rotvec([0.3, -0.2, 0.9]), Rotation.from_rotvec([-0.4, 0.1, -1.2])


def built(folder: Path, actuation: str, role: str = "attacker") -> Path:
    gcc = shutil.which("gcc")
    if gcc is None:
        pytest.skip("gcc is not installed")
    sim = SimConfig(body="brushless", actuation=actuation)  # pyright: ignore
    policy = make_policy(SIZES)
    info = make_info(Config(sim=sim), layer_sizes=SIZES, role=role)
    save_policy(folder / "policy.safetensors", policy, info)
    (folder / "policy.h").write_text(header_of(policy, info))
    support = ROOT / "tests/support/firmware"
    line = [gcc, *STRICT, f"-I{folder}", f"-I{support}", f"-I{ROOT / 'examples/firmware/src'}"]
    line += [str(support / "harness.c"), "-o", str(folder / "fly"), "-lm"]
    done = subprocess.run(line, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return folder / "fly"


def answers(program: Path, *commands: str) -> list[str]:
    done = subprocess.run(
        [program], input="\n".join(commands), capture_output=True, text=True, timeout=30
    )
    assert done.returncode == 0, (done.returncode, done.stdout)
    first, *rest = done.stdout.splitlines()
    assert first == "test 1"
    return rest


def state(at: int, sign: float = 1.0, **changes: tuple[float, ...]) -> str:
    """A step of the stabilizer, in the firmware's units: xyzw, deg/s."""
    own = OWN | changes
    numbers = (
        *own["position"],
        *(sign * TURNS[0].as_quat()),
        *own["velocity"],
        *np.degrees(own["rate"]),
    )
    return f"state {at} " + " ".join(f"{number:.9g}" for number in numbers)


def opponent(fly: int = 1) -> str:
    """An app-channel packet: mm, mm/s, wxyz in 1/32767, 0.01 rad/s."""
    whole = lambda values, scale: [round(value * scale) for value in values]
    turn = whole(np.roll(TURNS[1].as_quat(), 1), 32767)
    numbers = [*whole(OTHER["position"], 1000), *whole(OTHER["velocity"], 1000), *turn]
    packed = struct.pack("<BB13h", 1, fly, *numbers, *whole(OTHER["rate"], 100))
    assert len(packed) <= 31
    return f"packet {packed.hex()}"


def target() -> str:
    return "packet " + struct.pack("<BB3h", 2, 0, *(round(1000 * x) for x in TARGET)).hex()


def observed(role: str) -> np.ndarray:
    """What the game would observe of the same two drones."""
    sides = [OWN, OTHER] if role == "defender" else [OTHER, OWN]
    turns = TURNS if role == "defender" else TURNS[::-1]
    field = lambda name: jnp.asarray([side[name] for side in sides], jnp.float32)
    quaternions = jnp.asarray([np.roll(turn.as_quat(), 1) for turn in turns], jnp.float32)
    velocity, rate = field("velocity"), field("rate")
    drones = Drones(field("position"), quaternions, velocity, rate)
    return np.asarray(observe_world(drones, jnp.asarray(TARGET)))[SIDES.index(role)]


@pytest.mark.parametrize("role", SIDES)
def test_it_observes_as_the_game_does(tmp_path: Path, role: str):
    """Also where the firmware's quaternion has the other sign."""
    program = built(tmp_path, "mixed", role)
    for sign in (1.0, -1.0):
        _, seen = answers(program, state(1, sign), opponent(), target(), "observe")
        np.testing.assert_allclose(np.array(seen.split(), float), observed(role), atol=3e-4)


@pytest.mark.parametrize("actuation", ["rotors", "mixed", "ctbr"])
def test_actions_become_commands(tmp_path: Path, actuation: str):
    program = built(tmp_path, actuation)
    sent = (state(1), opponent(), target(), "observe", "think", state(2))
    before, seen, given = answers(program, *sent)
    observation = np.array(seen.split(), np.float32)
    action = np.clip(NumpyPolicy(tmp_path / "policy.safetensors")(observation), -1, 1)
    rotors, weight = ROTORS["brushless"], 0.0393 * 9.81
    least = rotors.min_thrust / rotors.max_thrust
    share = lambda number: least + (1 - least) * (number + 1) / 2
    rates = np.degrees(np.array(rotors.max_rates) * action[1:] * [1, -1, 1])
    kind, wanted = {
        "rotors": ("forces", share(action)),
        "mixed": ("torques", [1.9 * weight * (action[0] + 1) / 2, *(0.01 * action[1:])]),
        "ctbr": ("rates", [65535 * share(action[0]), *rates]),
    }[actuation]
    assert before == "stock" and given.split()[0] == kind
    np.testing.assert_allclose(np.array(given.split()[1:], float), wanted, rtol=1e-4, atol=1e-8)
    assert np.abs(action).max() < 1.0


READY = (state(1), opponent(), target(), "think")


@pytest.mark.parametrize(
    ("commands", "flies"),
    [
        ((*READY, state(2)), [False, True]),
        ((state(1), opponent(), "think", state(2)), [False, False]),  # no target
        ((state(1), target(), "think", state(2)), [False, False]),  # no opponent
        ((state(1), opponent(fly=0), target(), "think", state(2)), [False, False]),
        ((*READY, opponent(fly=0), state(2)), [False, False]),  # let go
        ((*READY, state(40), state(70)), [False, True, False]),  # the action is older than 60 ms
        ((*READY, state(100), "think", state(151), "think", state(152)), [False, False, True, False]),  # no packet
        ((*READY, state(2, position=(2.1, 0, 1)), state(3)), [False, False, False]),  # barred
        ((*READY, state(2, position=(0, 0, 0.2)), opponent(0), opponent(1), state(3)), [False, False, True]),
        ((*READY, state(2, velocity=(3.0, 1.0, 0)), state(3)), [False, False, False]),
        ((*READY, state(2, rate=(float("nan"), 0, 0)), "think", state(3)), [False, False, False]),
    ],
)  # fmt: skip
def test_it_hands_over(tmp_path_factory, commands: tuple[str, ...], flies: list[bool]):
    folder = tmp_path_factory.getbasetemp() / "controller"
    program = folder / "fly"
    if not program.is_file():
        folder.mkdir(exist_ok=True)
        program = built(folder, "mixed")
    assert [line != "stock" for line in answers(program, *commands)] == flies


@pytest.mark.parametrize(
    ("line", "by", "message"),
    [
        ("DRONECOMBAT_ACTUATION DRONECOMBAT_MIXED", "DRONECOMBAT_ACTUATION 0", "no rotors give"),
        ("DRONECOMBAT_WORLD 1", "DRONECOMBAT_WORLD 0", "the observation `world`"),
    ],
)
def test_what_it_cannot_fly_does_not_compile(tmp_path: Path, line: str, by: str, message: str):
    built(tmp_path, "mixed")
    header = tmp_path / "policy.h"
    header.write_text(header.read_text().replace(line, by))
    support = ROOT / "tests/support/firmware"
    folders = (f"-I{tmp_path}", f"-I{support}", f"-I{ROOT / 'examples/firmware/src'}")
    done = subprocess.run(
        ["gcc", *folders, "-c", str(support / "harness.c"), "-o", "/dev/null"],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode != 0 and message in done.stderr
