"""What every test shares: the environment is settled before JAX starts, programs are compiled once."""

import gc
import os
import signal
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace

import pytest

from dronecombat_jax.machine import backend

os.environ.setdefault("DRONECOMBAT_CACHE", str(Path(__file__).parents[1] / ".cache"))
os.environ.pop("MPLBACKEND", None)  # a notebook's: no test opens a window
# Programs are compiled often here and run briefly: LLVM's optimisation costs more than it brings.
LITTLE_OPTIMISATION = (
    "--xla_backend_optimization_level=0",
    "--xla_llvm_disable_expensive_passes=true",
    "--xla_cpu_parallel_codegen_split_count=1",  # two cores, two test processes
)
if metadata.version("jaxlib").startswith("0.9."):  # half the time; later versions lack the flag
    LITTLE_OPTIMISATION += ("--xla_cpu_use_fusion_emitters=false",)
os.environ["XLA_FLAGS"] = " ".join([os.environ.get("XLA_FLAGS", ""), *LITTLE_OPTIMISATION]).strip()
# A shell's background job ignores Ctrl-C, and so would every program that a test starts.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
backend.prepare("cpu")
# Tracing makes millions of small objects that live: looking for cycles took a tenth of the time.
gc.set_threshold(100_000, 20, 10)


@pytest.fixture(scope="session")
def arena() -> SimpleNamespace:
    """The default environment for 8 fights: `combat`, jitted `reset(keys)` and `step(states,
    actions)`, `traces`.
    """
    import jax

    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.config.fields import Config

    combat, traces = Combat(Config()), []

    def step(state, action):
        traces.append(action.shape)
        return combat.step(state, action)

    return SimpleNamespace(
        combat=combat,
        reset=jax.jit(lambda keys: jax.vmap(combat.reset)(keys)),
        step=jax.jit(jax.vmap(step)),
        traces=traces,
        size=8,
    )
