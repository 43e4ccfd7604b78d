"""What SIGINT, SIGTERM and SIGUSR1 do, from a command's first moment to its last.

While nothing has to be saved, one signal ends the process (`ending_at_once`). While a run or a
tournament goes on, the first signal asks for a save and the second one ends the process
(`stop_signals`).

Python runs its signal handlers on the main thread, which can sit for minutes in one compiled
program or in the compiler. The signals therefore go through `signal.set_wakeup_fd` (written by the
C handler at once) to a small thread, so that the answer and the second signal never wait. No
handler here raises KeyboardInterrupt: modules written in C lose it or abort while they are
imported, and destructors and callbacks lose it, too.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from dronecombat_jax.errors import EXIT_STOPPED

EXIT_INTERRUPTED = 130  # what a shell reports of a process that SIGINT has ended
STOP_SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGUSR1)
# `timeout` and some launchers deliver one signal twice, to the process and to its group.
REPEAT_SECONDS = 0.1


class StopFlag:
    """Read between program calls: true once a stop signal has come."""

    def __init__(self) -> None:
        self._event = threading.Event()
        self.signal_name = ""

    def __bool__(self) -> bool:
        return self._event.is_set()

    def request(self, name: str) -> None:
        """Ask for a stop, as a signal does."""
        self.signal_name = self.signal_name or name
        self._event.set()


@contextmanager
def ending_at_once() -> Iterator[None]:
    """Let a stop signal end the process where it stands: exit 130 after SIGINT, else 75.

    For the whole of a command, on the main thread. `stop_signals` takes over for as long as there
    is something to save. After the block the signals have the system's own action: while Python
    itself ends, it runs no handler.
    """
    with _watched(_leave):
        for number in STOP_SIGNALS:
            signal.signal(number, lambda number, frame: None)
        try:
            yield
        finally:
            for number in STOP_SIGNALS:
                signal.signal(number, signal.SIG_DFL)


@contextmanager
def stop_signals(announce: Callable[[str], None] | None = None) -> Iterator[StopFlag]:
    """Catch SIGTERM, SIGINT and SIGUSR1 inside the block; the old handlers come back after it.

    `announce` gets the name of the first signal, on another thread. A second signal ends the
    process with exit code 128 + signal. Off the main thread nothing can be caught: the flag then
    stays false. TRAP: a signal may come after the last look at the flag; look at it once more after
    the block.
    """
    flag = StopFlag()
    if threading.current_thread() is not threading.main_thread():
        yield flag
        return
    previous = {number: signal.signal(number, _noting(flag)) for number in STOP_SIGNALS}
    try:
        with _watched(_first_and_second(flag, announce)):
            yield flag
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)


@contextmanager
def _watched(heard: Callable[[int], None]) -> Iterator[None]:
    """Call `heard` with every stop signal that has a Python handler, on a thread of its own."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    watcher = threading.Thread(target=_watch, args=(reading, heard), daemon=True)
    watcher.start()
    previous = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(previous)
        os.close(writing)  # the watcher reads the end of the pipe and leaves
        watcher.join(timeout=1.0)


def _watch(reading: int, heard: Callable[[int], None]) -> None:
    while received := os.read(reading, 1):
        if received[0] in STOP_SIGNALS:  # every signal with a Python handler is reported
            heard(received[0])
    os.close(reading)


def _noting(flag: StopFlag) -> Callable[[int, FrameType | None], None]:
    """The Python-level handler: it replaces the default action and sets the flag on its own thread
    too.
    """
    return lambda number, frame: flag.request(signal.Signals(number).name)


def _first_and_second(
    flag: StopFlag,
    announce: Callable[[str], None] | None,
) -> Callable[[int], None]:
    """What each signal does: the first one sets the flag and is announced, the second one ends."""
    first: tuple[int, float] | None = None

    def heard(number: int) -> None:
        nonlocal first
        now = time.monotonic()
        if first is None:
            first = number, now
            flag.request(signal.Signals(number).name)
            if announce is not None:
                with suppress(Exception):  # a broken terminal must not cost the second signal
                    announce(flag.signal_name)
        elif number != first[0] or now - first[1] > REPEAT_SECONDS:
            _end(128 + number)

    return heard


def _leave(number: int) -> None:
    with suppress(OSError):
        os.write(2, b"stopped\n")
    _end(EXIT_INTERRUPTED if number == signal.SIGINT else EXIT_STOPPED)


def _end(code: int) -> None:
    """Leave without unwinding: everything acknowledged is on the disk, the kernel drops the lock."""
    with suppress(Exception):
        if sys.stdout.isatty():
            os.write(sys.stdout.fileno(), b"\x1b[?25h\n")  # the progress display hides the cursor
    os._exit(code)
