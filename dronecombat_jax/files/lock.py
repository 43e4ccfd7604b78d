"""One writer per run directory: an exclusive `flock` that the kernel drops when its process dies.

The lock file is never removed: a second process could otherwise lock a name that is already gone.
"""

import errno
import fcntl
import json
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dronecombat_jax.errors import EXIT_CANNOT_WRITE, UserError
from dronecombat_jax.files.atomic import cannot_write, write_all

LOCK_NAME = ".lock"
_ASKING_SECONDS = 0.05  # far longer than `in_use` holds a lock


@contextmanager
def exclusive_lock(directory: Path) -> Iterator[None]:
    """Hold `directory` for this process, or raise UserError 73 naming the process that holds it."""
    path = directory / LOCK_NAME
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
    except OSError as error:
        raise cannot_write(path, error) from error
    try:
        _acquire(descriptor, directory)
        _sign(descriptor, path)
        yield
    finally:
        os.close(descriptor)


def in_use(directory: Path) -> bool:
    """Whether another process holds `directory`; False where it cannot be asked."""
    try:
        descriptor = os.open(directory / LOCK_NAME, os.O_RDONLY | os.O_NOFOLLOW)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno in (errno.EWOULDBLOCK, errno.EACCES)
    finally:
        os.close(descriptor)
    return False


def _acquire(descriptor: int, directory: Path) -> None:
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(_ASKING_SECONDS)  # it may be somebody who only asks
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
            message = (
                f"cannot lock {directory}: {error.strerror} (does this file system support flock?)"
            )
            raise UserError(message, EXIT_CANNOT_WRITE) from error
        message = f"{directory} is in use by {_holder(descriptor)}; stop it or choose another name"
        raise UserError(message, EXIT_CANNOT_WRITE) from error


def _sign(descriptor: int, path: Path) -> None:
    signature = {"pid": os.getpid(), "host": socket.gethostname(), "since": time.time()}
    try:
        os.ftruncate(descriptor, 0)
        write_all(descriptor, json.dumps(signature).encode())
    except OSError as error:
        raise cannot_write(path, error) from error


def _holder(descriptor: int) -> str:
    """Who signed the lock file. The text is only a hint: the kernel's lock is what counts."""
    try:
        signature = json.loads(os.pread(descriptor, 4096, 0))
        host = "".join(character for character in str(signature["host"]) if character.isprintable())
        return f"process {int(signature['pid'])} on {host[:100]}"
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return "another process"  # between its flock and its signature
