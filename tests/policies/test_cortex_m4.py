"""The C header on a Cortex-M4 with FPU, such as a Crazyflie has: size, and actions in an emulator."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from policies import SIZES, make_info, make_policy

from dronecombat_jax.config.fields import Config, SimConfig
from dronecombat_jax.learn.mates import only
from dronecombat_jax.policies import shipped
from dronecombat_jax.policies.c_header import TESTS, TOLERANCE, header_of
from dronecombat_jax.policies.file import load_policy
from dronecombat_jax.policies.numpy_policy import NumpyPolicy

BOARD = Path(__file__).parents[1] / "support" / "cortex_m4"
CORE = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-ffunction-sections", "-fdata-sections")
LINKED = ("-nostartfiles", "--specs=nano.specs", "-Wl,--gc-sections")
FLASH, STACK = 1024 * 1024, 512  # bytes: of a Crazyflie's STM32F405; that a task can spare
OBSERVATIONS = 16


@pytest.fixture(scope="module")
def pilot() -> tuple[str, np.ndarray, np.ndarray]:
    """A shipped pilot's header, observations [N, 35] about what it has seen, exact actions."""
    (file,) = shipped.paths("ippo-attacker-34")
    saved, info = load_policy(file)
    policy = only(saved, "a header")
    scaler, random = policy.observation_scaler, np.random.default_rng(1)
    spread = np.sqrt(np.asarray(scaler.variance))
    seen = np.asarray(scaler.mean) + spread * random.normal(size=(OBSERVATIONS, len(spread)))
    seen = seen.astype(np.float32)
    exact = NumpyPolicy(file)
    exact.layers = [(weight.astype(float), bias.astype(float)) for weight, bias in exact.layers]
    return header_of(policy, info), seen, np.clip(exact(seen), -1.0, 1.0)


def tool(name: str) -> str:
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"{name} is not installed")
    return found


def built(folder: Path, header: str, seen: np.ndarray, *flags: str) -> Path:
    (folder / "policy.h").write_text(header)
    numbers = ", ".join(f"{float(value).hex()}f" for value in seen.ravel())
    (folder / "observations.h").write_text(
        f"#define TESTS {len(seen)}\nstatic const float test_observations[] = {{{numbers}}};\n"
    )
    program = folder / "fly.elf"
    line = [tool("arm-none-eabi-gcc"), *CORE, *STRICT, *flags, f"-I{folder}", str(BOARD / "main.c")]
    line += ["-T", str(BOARD / "board.ld"), *LINKED, "-o", str(program), "-lm"]
    done = subprocess.run(line, capture_output=True, text=True, timeout=300, cwd=folder)
    assert done.returncode == 0, done.stderr
    return program


def sizes(program: Path) -> tuple[int, int]:
    """Bytes of flash, and of memory."""
    line = [tool("arm-none-eabi-size"), str(program)]
    done = subprocess.run(line, capture_output=True, text=True, timeout=60, check=True)
    text, data, bss = map(int, done.stdout.splitlines()[1].split()[:3])
    return text + data, data + bss


@pytest.mark.slow
@pytest.mark.parametrize("level", ["-Os", "-O2"])
def test_it_fits_a_crazyflie(tmp_path: Path, pilot, level: str):
    header, seen, _ = pilot
    static = "-DDRONECOMBAT_BUFFERS=static"
    program = built(tmp_path, header, seen, level, static, "-fstack-usage")
    flash, memory = sizes(program)
    usage = next(tmp_path.glob("*.su")).read_text().splitlines()
    stack = max(int(line.split("\t")[1]) for line in usage)
    print(f"\n{level}: {flash:,} bytes of flash, {memory:,} of memory, {stack} of stack a function")
    weights = 4 * (35 * 256 + 256 * 128 + 128 * 4 + 256 + 128 + 4)
    assert weights < flash < weights + 16 * 1024 and flash < FLASH / 4
    assert 2 * 4 * 256 <= memory < 2 * 4 * 256 + 256 and stack < STACK


@pytest.mark.slow
def test_an_emulated_one_gives_the_actions(tmp_path: Path, pilot):
    """QEMU's mps2-an386; an instruction is 1 ns under -icount, which the core's timer counts."""
    header, seen, actions = pilot
    emulator = tool("qemu-system-arm")
    program = built(tmp_path, header, seen, "-O2")
    line = [emulator, "-M", "mps2-an386", "-nographic", "-semihosting-config"]
    line += ["enable=on,target=native", "-icount", "shift=0", "-kernel", str(program)]
    done = subprocess.run(line, capture_output=True, timeout=300)
    words = [int(word) for word in (done.stdout + done.stderr).split()]
    floats = np.array(words[:-1], np.uint32).view(np.float32)
    assert len(floats) == 1 + 4 * len(seen) and floats[0] <= TOLERANCE
    np.testing.assert_allclose(floats[1:].reshape(-1, 4), actions, atol=1e-6)
    print(f"\n{words[-1]:,} instructions a call")
    products = 35 * 256 + 256 * 128 + 128 * 4
    assert 3 * products < words[-1] < 12 * products and TESTS > 0


@pytest.mark.slow
def test_the_controller_for_the_firmware_compiles_for_it(tmp_path: Path):
    """Against declarations of the firmware's interface; the policy's header is in it."""
    sim = SimConfig(body="brushless", actuation="ctbr")
    info = make_info(Config(sim=sim), layer_sizes=SIZES)
    (tmp_path / "policy.h").write_text(header_of(make_policy(SIZES), info))
    root = Path(__file__).parents[2]
    folders = (f"-I{tmp_path}", f"-I{root / 'tests/support/firmware'}")
    line = [tool("arm-none-eabi-gcc"), *CORE, *STRICT[1:], "-std=gnu11", "-Os", *folders, "-c"]
    line += [str(root / "examples/firmware/src/dronecombat_controller.c"), "-o", "controller.o"]
    done = subprocess.run(line, capture_output=True, text=True, timeout=300, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    flash, memory = sizes(tmp_path / "controller.o")
    print(f"\n{flash:,} bytes of flash, {memory:,} of memory, with a network of {SIZES}")
    assert flash < 16 * 1024 and memory < 1024
