"""Files that are there whole or not at all, and the message when the disk refuses.

What lives here: temporary names, fsync, atomic replacement, sweeping of left-overs. What does
not: what the files mean (`rundir`, `checkpoint`, `metrics`).
"""

import contextlib
import errno
import os
import re
import secrets
import shutil
from pathlib import Path

from dronecombat_jax.errors import EXIT_CANNOT_WRITE, UserError

TEMPORARY_PREFIX = ".tmp-"


def temporary_path(path: Path) -> Path:
    """A name beside `path` that no other process uses; `sweep` knows it by its prefix."""
    return path.parent / f"{TEMPORARY_PREFIX}{path.name}-{os.getpid()}-{secrets.token_hex(4)}"


def write_atomic(path: Path, data: str | bytes) -> None:
    """Replace `path` by `data`: after a crash it holds the old content or the new, never a mixture.

    Raises UserError 73 naming the path; the old file is then intact and no temporary one is left.
    """
    content = data.encode() if isinstance(data, str) else data
    temporary = temporary_path(path)
    try:
        write_new(temporary, content)
        os.replace(temporary, path)
        fsync_directory(path.parent)
    except OSError as error:
        raise cannot_write(path, error, len(content)) from error
    finally:
        with contextlib.suppress(OSError):  # a name too long, say: the error above tells
            temporary.unlink()


def write_new(path: Path, content: bytes) -> None:
    """Create `path`, which must not exist, and see its bytes to the disk. Raises OSError."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o666)
    try:
        write_all(descriptor, content)
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_all(descriptor: int, content: bytes) -> None:
    """`os.write` until nothing is left: a nearly full disk takes a part and then refuses."""
    rest = memoryview(content)
    while rest:
        rest = rest[os.write(descriptor, rest) :]


def fsync_directory(path: Path) -> None:
    """Make the names in a directory (a rename, a new file) survive a power cut."""
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        # Some network and FUSE file systems cannot sync a directory; nothing better exists there.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


def fsync_tree(root: Path) -> None:
    """See every file and every directory below `root` to the disk, `root` last."""
    for folder, _, names in os.walk(root, topdown=False):
        for name in names:
            descriptor = os.open(os.path.join(folder, name), os.O_RDONLY | os.O_NOFOLLOW)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
        fsync_directory(Path(folder))


def sweep(directory: Path) -> list[Path]:
    """Remove what killed writers left half done in `directory`; returns it.

    Only for the holder of the run's lock: another writer's files look the same.
    """
    if not directory.is_dir():
        return []
    leftovers = sorted(
        path for path in directory.iterdir() if path.name.startswith(TEMPORARY_PREFIX)
    )
    for path in leftovers:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
    return leftovers


def cannot_write(path: Path, error: Exception, needed: int | None = None) -> UserError:
    """The one line for a refused write: path, reason, bytes needed and bytes free."""
    space = "" if needed is None else f"; {needed:,} bytes needed{_free_space(path)}"
    return UserError(f"cannot write {path}: {_reason(error)}{space}", EXIT_CANNOT_WRITE)


def _reason(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    # tensorstore wraps the operating system's answer in a paragraph
    code = re.search(r"os_error_code='?(\d+)", str(error))
    if code:
        return os.strerror(int(code.group(1)))
    return " ".join(str(error).split())[:200] or type(error).__name__


def _free_space(path: Path) -> str:
    existing = next((folder for folder in path.parents if folder.exists()), None)
    try:
        return "" if existing is None else f", {shutil.disk_usage(existing).free:,} free"
    except OSError:
        return ""
