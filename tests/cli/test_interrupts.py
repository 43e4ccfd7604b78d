"""Ctrl-C and SIGTERM at any moment of a command: 130 or 75, never swallowed, never a traceback.

A real training is interrupted, at times and in its phases. Judged is the outcome, not the time: on
a busy machine the same moment is another phase. While Python itself starts, before this package's
first line, it answers by itself; the kernel says whether a process is past that (`guarded`).
"""

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dronecombat_jax.errors import EXIT_STOPPED

COMMAND = [str(Path(sys.executable).with_name("dronecombat")), "train", "--preset", "smoke"]
EXIT_INTERRUPTED = 130
PATIENCE = 1500.0  # s, on a machine that has much else to do

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="needs /proc"),
    pytest.mark.timeout(2 * PATIENCE),
]


class Command:
    """`dronecombat train --preset smoke` in a folder of its own, and what it has printed so far."""

    def __init__(self, folder: Path, *flags: str):
        folder.mkdir(exist_ok=True)
        self.run, self._out = folder / "runs" / "ippo-smoke", (folder / "out").open("w+")
        self._err = (folder / "err").open("w+")
        self.process = subprocess.Popen(
            [*COMMAND, *flags], cwd=folder, stdout=self._out, stderr=self._err
        )

    def guarded(self) -> bool:
        """Whether the package has settled what signals do: Python itself never catches SIGTERM."""
        try:
            status = Path(f"/proc/{self.process.pid}/status").read_text()
        except OSError:
            return False
        (caught,) = (
            int(line.split()[1], 16) for line in status.splitlines() if line.startswith("SigCgt:")
        )
        return bool(caught >> (signal.SIGTERM - 1) & 1)

    def wait_for(self, ready: Callable[["Command"], bool]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not ready(self):
            assert self.process.poll() is None and time.monotonic() < deadline, self.printed()
            time.sleep(0.001)

    def printed(self) -> tuple[str, str]:
        return tuple(Path(file.name).read_text() for file in (self._out, self._err))  # pyright: ignore[reportReturnType]

    def interrupt(self, number: signal.Signals) -> int:
        """Send a signal, wait for the end and judge it; returns the exit code."""
        guarded = self.guarded()
        self.process.send_signal(number)
        code = self.process.wait(PATIENCE)
        out, err = self.printed()
        assert code != 0, f"swallowed\n{out}"
        if guarded:
            assert code in (
                (EXIT_INTERRUPTED, EXIT_STOPPED) if number == signal.SIGINT else (EXIT_STOPPED,)
            ), err
            assert "Traceback" not in err and "Exception" not in err and "Abort" not in err, err
            assert err.splitlines() == ["stopped"] or f"{number.name}: saving and stopping" in out
        else:
            own = err.replace("dronecombat_jax/__main__.py", "").replace(
                "dronecombat_jax/__init__.py", ""
            )
            assert "dronecombat_jax/" not in own, err
        return code


@pytest.fixture
def begin() -> Iterator[Callable[..., Command]]:
    """Begins a training in a folder with flags; what has not ended with the test is killed."""
    begun = []

    def start(folder: Path, *flags: str) -> Command:
        begun.append(Command(folder, *flags))
        return begun[-1]

    yield start
    for command in begun:
        command.process.kill()
        command.process.wait()


def says(words: str) -> Callable[[Command], bool]:
    return lambda command: words in command.printed()[0]


def saves(command: Command) -> bool:
    """A checkpoint is being written, and not the untrained one."""
    folder = command.run / "checkpoints"
    return (folder / "0").is_dir() and any(
        path.name.startswith(".tmp-") for path in folder.iterdir()
    )


PHASES = {
    "guard": Command.guarded,
    "settings": says("settings: preset"),
    "banner": says("set by us"),
    "compiling": says("compiling the training program"),
    "training": says("compiled the training program"),
    "saving": saves,
    "figures": says(" 100 %"),
    "evaluation": says("learning curves: "),
    "video": lambda command: (command.run / "evaluation.json").is_file(),
}


@pytest.mark.parametrize(
    "seconds", [0.02, 0.15, 0.4, 0.8, pytest.param(1.6, marks=pytest.mark.slow)]
)
def test_an_interrupt_in_the_first_seconds(begin, tmp_path, seconds):
    command = begin(tmp_path)
    time.sleep(seconds)
    command.interrupt(signal.SIGINT)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGUSR1])
def test_a_signal_from_the_first_line_on_ends_the_command(begin, tmp_path, number):
    command = begin(tmp_path)
    command.wait_for(Command.guarded)
    assert command.interrupt(number) == (
        EXIT_INTERRUPTED if number == signal.SIGINT else EXIT_STOPPED
    )


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_a_signal_at_every_twentieth_of_the_first_two_seconds(begin, tmp_path, number):
    for i in range(1, 41):
        command = begin(tmp_path / str(i))
        time.sleep(i / 20)
        command.interrupt(number)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
@pytest.mark.parametrize("phase", PHASES)
def test_a_signal_in_every_phase(begin, tmp_path, phase, number):
    flags = ("--run.video", "--steps", "30_720")
    command = begin(tmp_path, *flags)
    command.wait_for(PHASES[phase])
    code = command.interrupt(number)
    if phase in ("compiling", "training", "saving"):  # the same command goes on from what was saved
        assert code == EXIT_STOPPED and (command.run / "checkpoints" / "0").is_dir()
    if number == signal.SIGTERM:
        assert begin(tmp_path, *flags).process.wait(PATIENCE) == 0
