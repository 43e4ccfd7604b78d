"""JAX's variables: numbers stay float32, whatever is set."""

import subprocess
import sys

import pytest
from prepared import CLEAN, prepared

from dronecombat_jax.errors import EXIT_CONFIG

NUMBERS = """
import sys
from dronecombat_jax.machine import backend
if {before}: import jax
backend.prepare("cpu")
import jax, jax.numpy as jnp
print((jnp.arange(2) + jnp.ones((2, 2)) * 0.5).dtype, jax.jit(lambda x: isinstance(x, jax.core.Tracer))(1.0))
"""


@pytest.mark.parametrize(
    ("name", "value", "before"),
    [
        ("JAX_ENABLE_X64", "1", False),
        ("JAX_ENABLE_X64", "1", True),  # JAX has read it already
        ("JAX_NUMPY_DTYPE_PROMOTION", "strict", False),
        ("JAX_NUMPY_RANK_PROMOTION", "raise", False),
        ("JAX_DISABLE_JIT", "true", False),
        ("JAX_USE_SHARDY_PARTITIONER", "0", False),
        ("JAX_TRANSFER_GUARD", "disallow", True),
        ("JAX_ERROR_CHECKING_BEHAVIOR_NAN", "raise", False),
    ],
)
def test_numbers_are_float32_whatever_is_set(tmp_path, name, value, before):
    environment = CLEAN | {"DRONECOMBAT_CACHE": str(tmp_path), name: value}
    command = [sys.executable, "-c", NUMBERS.format(before=before)]
    result = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert result.stdout == "float32 True\n", result.stderr
    (line,) = (line for line in result.stderr.splitlines() if line.startswith("note: "))
    assert line.startswith(f"note: {name}={value!r} is not used: ")


def test_what_changes_nothing_is_neither_mentioned_nor_does_it_start_jax(tmp_path):
    harmless = {
        "JAX_ENABLE_X64": "False",
        "JAX_TRANSFER_GUARD": "log",
        "JAX_PLATFORMS": "cpu",
        "JAX_COMPILATION_CACHE_DIR": str(tmp_path),
    }
    found = prepared(tmp_path, device="auto", **harmless)
    assert found["said"] == "" and harmless.items() <= found.items()
    assert found["set by us"].keys() & harmless.keys() == set()


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("JAX_PLATFORMS", "cuda", "there is no such device on this machine"),
        ("JAX_PLATFORMS", "foo", "Unable to initialize backend 'foo'"),
        ("JAX_PLATFORM_NAME", "cuda", "Unknown backend cuda"),
        ("JAX_DEFAULT_DEVICE", "cuda", "jax.default_device must be passed"),
        ("JAX_DEFAULT_PRNG_IMPL", "foo", 'Invalid value "foo"'),
        ("JAX_DEBUG_NANS", "foo", "invalid truth value 'foo'"),
        ("JAX_NO_EXECUTION", "1", "JAX tried to execute function"),
    ],
)
def test_variables_with_which_jax_does_not_start_are_one_line(tmp_path, name, value, reason):
    """Every command that computes prepares so; `cpu` by name wins over the devices among the
    variables.
    """
    environment = CLEAN | {"DRONECOMBAT_CACHE": str(tmp_path), name: value}
    command = [
        sys.executable,
        "-m",
        "dronecombat_jax",
        "tournament",
        "scripted:dash",
        "--name",
        str(tmp_path / "t"),
    ]
    result = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert (result.returncode, result.stdout) == (EXIT_CONFIG, "")
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"error: JAX does not start with {name}='{value}' ({reason}")


def test_a_program_in_float64_is_told_that_the_game_is_float32():
    code = """
import jax
jax.config.update("jax_enable_x64", True)
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.fields import Config
from dronecombat_jax.errors import UserError
try:
    Combat(Config())
except UserError as error:
    print(error.exit_code, error.message)
jax.config.update("jax_enable_x64", False)
assert Combat(Config()).reset(jax.random.key(0)).qpos.dtype == "float32"
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith(
        "2 jax_enable_x64 is on, and the game and its networks compute in float32. Fix: "
    )
    assert len(result.stdout.splitlines()) == 1
