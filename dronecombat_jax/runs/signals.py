"""Stopping politely: the first signal asks for a save, the second ends the process at once.

Python runs its signal handlers on the main thread, which can sit for minutes in one compiled
program or in the compiler. The signals therefore go through `signal.set_wakeup_fd` (written by the
C handler at once) to a small thread, so that the answer and the second signal never wait.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

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
def stop_signals(announce: Callable[[str], None] | None = None) -> Iterator[StopFlag]:
    """Catch SIGTERM, SIGINT and SIGUSR1 inside the block; the old handlers come back after it.

    `announce` gets the name of the first signal, on another thread. A second signal ends the
    process with exit code 128 + signal. Off the main thread nothing can be caught: the flag then
    stays false.
    """
    flag = StopFlag()
    if threading.current_thread() is not threading.main_thread():
        yield flag
        return
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    watcher = threading.Thread(target=_watch, args=(reading, flag, announce), daemon=True)
    watcher.start()
    previous = {number: signal.signal(number, _noting(flag)) for number in STOP_SIGNALS}
    previous_descriptor = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    try:
        yield flag
    finally:
        signal.set_wakeup_fd(previous_descriptor)
        for number, handler in previous.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)
        os.close(writing)  # the watcher reads the end of the pipe and leaves
        watcher.join(timeout=1.0)


def _noting(flag: StopFlag) -> Callable[[int, FrameType | None], None]:
    """The Python-level handler: it replaces the default action and sets the flag on its own thread too."""
    return lambda number, frame: flag.request(signal.Signals(number).name)


def _watch(reading: int, flag: StopFlag, announce: Callable[[str], None] | None) -> None:
    first: float | None = None
    first_number = 0
    while received := os.read(reading, 1):
        number, now = received[0], time.monotonic()
        if number not in STOP_SIGNALS:
            continue  # the wake-up descriptor reports every signal with a Python handler
        if first is None:
            first, first_number = now, number
            flag.request(signal.Signals(number).name)
            if announce is not None:
                with suppress(Exception):  # a broken terminal must not cost the second signal
                    announce(flag.signal_name)
        elif number != first_number or now - first > REPEAT_SECONDS:
            _end_at_once(number)
    os.close(reading)


def _end_at_once(number: int) -> None:
    """Leave without unwinding: everything acknowledged is on the disk, the kernel drops the lock."""
    with suppress(Exception):
        if sys.stdout.isatty():
            os.write(sys.stdout.fileno(), b"\x1b[?25h\n")  # the progress display hides the cursor
    os._exit(128 + number)
