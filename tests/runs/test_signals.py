"""The first signal asks, the second ends, also while the main thread sits in compiled code.

Where nothing has to be saved, the first one ends.
"""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from dronecombat_jax.errors import EXIT_STOPPED
from dronecombat_jax.runs.signals import EXIT_INTERRUPTED, STOP_SIGNALS, stop_signals

LOOP = """
import sys, time
from dronecombat_jax.runs.signals import stop_signals
with stop_signals() as stop:
    print("ready", flush=True)
    while not stop:
        time.sleep(0.01)
    print("saving after", stop.signal_name, flush=True)
    time.sleep(float(sys.argv[1]))
    print("saved", flush=True)
sys.exit(75)
"""

# pbkdf2 runs for minutes without the interpreter, as the XLA compiler does
BUSY = """
import hashlib
from dronecombat_jax.runs.signals import stop_signals
with stop_signals(lambda name: print("heard", name, flush=True)):
    print("ready", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 400_000_000)
"""

ENDING = """
import hashlib
from dronecombat_jax.runs.signals import ending_at_once, stop_signals
with ending_at_once():
    with stop_signals() as stop:
        print("ready", flush=True)
        while not stop:
            pass
    print("saved", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 400_000_000)
"""

ENDED = """
import time
from dronecombat_jax.runs.signals import ending_at_once
with ending_at_once():
    pass
print("ready", flush=True)
time.sleep(60)
"""


def start(script: str, *arguments: str) -> subprocess.Popen[str]:
    command, pipe = [sys.executable, "-c", script, *arguments], subprocess.PIPE
    child = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True)
    assert child.stdout is not None and child.stdout.readline() == "ready\n"
    return child


@pytest.mark.parametrize("number", STOP_SIGNALS)
def test_one_signal_saves_and_stops(number: signal.Signals):
    with start(LOOP, "0") as child:
        child.send_signal(number)
        output, _ = child.communicate(timeout=10)
    assert output == f"saving after {number.name}\nsaved\n" and child.returncode == EXIT_STOPPED


def test_one_signal_delivered_twice_counts_once():
    with start(LOOP, "0.3") as child:
        child.send_signal(signal.SIGTERM)
        child.send_signal(signal.SIGTERM)
        output, _ = child.communicate(timeout=10)
    assert output.endswith("saved\n") and child.returncode == EXIT_STOPPED


def test_a_second_signal_ends_at_once():
    with start(LOOP, "60") as child:
        assert child.stdout is not None
        child.send_signal(signal.SIGUSR1)
        assert child.stdout.readline() == "saving after SIGUSR1\n"
        child.send_signal(signal.SIGTERM)
        assert child.wait(timeout=5) == 128 + signal.SIGTERM


def test_both_signals_work_while_the_main_thread_is_busy():
    with start(BUSY) as child:
        assert child.stdout is not None
        child.send_signal(signal.SIGINT)
        assert child.stdout.readline() == "heard SIGINT\n"
        time.sleep(0.2)
        child.send_signal(signal.SIGINT)
        assert child.wait(timeout=5) == 128 + signal.SIGINT


@pytest.mark.parametrize("number", STOP_SIGNALS)
def test_where_nothing_has_to_be_saved_one_signal_ends_the_process(number: signal.Signals):
    """Before and after a run, also while the main thread is busy; during it the first one asks."""
    with start(ENDING) as child:
        assert child.stdout is not None
        child.send_signal(number)
        assert child.stdout.readline() == "saved\n"
        time.sleep(0.2)
        child.send_signal(number)
        _, err = child.communicate(timeout=10)
    assert err == "stopped\n"
    assert child.returncode == (EXIT_INTERRUPTED if number == signal.SIGINT else EXIT_STOPPED)


@pytest.mark.parametrize("number", STOP_SIGNALS)
def test_while_python_itself_ends_a_signal_has_the_systems_own_action(number: signal.Signals):
    with start(ENDED) as child:
        child.send_signal(number)
        _, err = child.communicate(timeout=10)
    assert (child.returncode, err) == (-number, "")


def test_old_handlers_come_back_and_nothing_leaks():
    before = {number: signal.getsignal(number) for number in STOP_SIGNALS}
    descriptors, threads = len(os.listdir("/proc/self/fd")), threading.active_count()
    with stop_signals() as stop:
        assert not stop
        os.kill(os.getpid(), signal.SIGUSR1)
        assert stop and stop.signal_name == "SIGUSR1"
    assert {number: signal.getsignal(number) for number in STOP_SIGNALS} == before
    assert (len(os.listdir("/proc/self/fd")), threading.active_count()) == (descriptors, threads)
    assert signal.set_wakeup_fd(-1) == -1


def test_off_the_main_thread_it_does_nothing():
    seen: list[bool] = []

    def work():
        with stop_signals() as stop:
            seen.append(bool(stop))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [False]
