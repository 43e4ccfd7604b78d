"""One writer per run directory, and a lock that dies with its holder."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from dronecombat_jax.errors import EXIT_CANNOT_WRITE, UserError
from dronecombat_jax.files.lock import LOCK_NAME, exclusive_lock

HOLD = """
import sys, time
from pathlib import Path
from dronecombat_jax.files.lock import exclusive_lock
with exclusive_lock(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_second_process_is_named_and_kill_frees_the_lock(tmp_path: Path):
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True
    ) as child:
        try:
            assert child.stdout is not None and child.stdout.readline() == "held\n"
            with pytest.raises(UserError) as caught, exclusive_lock(tmp_path):
                pass
            assert caught.value.exit_code == EXIT_CANNOT_WRITE
            assert f"process {child.pid} on {socket.gethostname()}" in caught.value.message
            assert str(tmp_path) in caught.value.message
        finally:
            child.send_signal(signal.SIGKILL)
        child.wait(timeout=10)
        with exclusive_lock(tmp_path):  # the file is still there, the lock is not
            assert (tmp_path / LOCK_NAME).exists()


@pytest.mark.parametrize(
    "signature", [b"", b"{", b'{"pid": "x"}', b"[" * 5000, b'{"pid": 1, "host": "a\\nb"}', b"\xff"]
)
def test_a_damaged_signature_does_not_matter(tmp_path: Path, signature: bytes):
    with exclusive_lock(tmp_path):
        (tmp_path / LOCK_NAME).write_bytes(signature)
        with pytest.raises(UserError) as caught, exclusive_lock(tmp_path):
            pass
        assert "\n" not in caught.value.message
    with exclusive_lock(tmp_path):
        assert str(os.getpid()) in (tmp_path / LOCK_NAME).read_text()


def test_a_lock_file_that_is_a_link_is_not_followed(tmp_path: Path):
    (tmp_path / LOCK_NAME).symlink_to(tmp_path / "precious")
    with pytest.raises(UserError), exclusive_lock(tmp_path):
        pass
    assert not (tmp_path / "precious").exists()
