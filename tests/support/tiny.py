"""Training by the command line at toy size, in a process of its own, compiled with little
optimisation.
"""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

WORDS = (
    "--preset smoke --seed 3 --train.num-envs 16 --train.chunk-iterations 2 --sim.substeps 1 --game.episode-steps 20 "
    "--learn.hidden-sizes 8 8 --learn.rollout-steps 6 --learn.epochs 2 --learn.minibatches 2 "
    "--train.num-seeds 2 --run.no-video --run.no-replay --run.evaluation-fights 4"
)
COMMAND = WORDS.split()
CHUNK = 2  # iterations of a chunk
STEPS = 16 * 6  # environment steps of an iteration
ENVIRONMENT = os.environ | {
    "XLA_FLAGS": f"{os.environ.get('XLA_FLAGS', '')} "
    "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true"
}
PATIENCE = 300.0  # seconds


def train(
    root: Path, name: str, *flags: str, environment: dict[str, str] | None = None
) -> subprocess.Popen[str]:
    """Begin, or go on with, a run in its own process."""
    command = [
        sys.executable,
        "-m",
        "dronecombat_jax",
        "train",
        "--name",
        name,
        "--run.directory",
        str(root),
    ]
    pipe = subprocess.PIPE
    variables = ENVIRONMENT | (environment or {})
    return subprocess.Popen(
        [*command, *COMMAND, *flags], stdout=pipe, stderr=pipe, text=True, env=variables
    )


def train_together(root: Path, name: str, *flags: str) -> list[subprocess.Popen[str]]:
    """The same in two processes that meet on this machine."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    together = {"JAX_COORDINATOR_ADDRESS": address, "JAX_NUM_PROCESSES": "2"}
    each = ("--run.distributed", *flags)
    return [
        train(root, name, *each, environment=together | {"JAX_PROCESS_ID": str(index)})
        for index in range(2)
    ]


def finish(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Exit code, stdout and stderr once it has ended."""
    out, err = process.communicate(timeout=PATIENCE)
    return process.returncode, out, err


def interrupt(
    process: subprocess.Popen[str], run: Path, after: int, number: signal.Signals
) -> tuple[int, str, str]:
    """Send a signal once the checkpoint of `after` iterations is there."""
    deadline = time.monotonic() + PATIENCE
    while not (run / "checkpoints" / str(after)).exists():
        assert process.poll() is None and time.monotonic() < deadline, process.communicate()
        time.sleep(0.005)
    process.send_signal(number)
    return finish(process)


def kill_while_compiling(process: subprocess.Popen[str]) -> None:
    """SIGKILL after the line that announces the compilation."""
    assert process.stdout is not None
    for line in process.stdout:
        if line.startswith("compiling the training program"):
            break
    process.kill()
    process.communicate(timeout=PATIENCE)
    assert process.returncode == -signal.SIGKILL
