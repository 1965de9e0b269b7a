"""Atomic writing: a file appears whole or not at all, and a failure leaves the existing file unchanged.

A regular file is written under a temporary name in the same folder and then renamed, with the mode and owner of the file
that it replaces. Symbolic links are followed. Anything but a regular file (a FIFO, a device, an open descriptor such as
/dev/stdout or that of a process substitution) is written directly. A file that the running command reads is never written.
"""

from __future__ import annotations

import errno
import os
import re
import secrets
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

PART = ".antinode-part"  # ends the name of every file that is being written
MAX_LINKS = 40
OPEN_FILES = r"/proc/{pid}(/task/\d+)?/fd|/dev/fd"
FilePath = str | os.PathLike[str]

_inputs: ContextVar[list[Path] | None] = ContextVar("inputs", default=None)


class UnwritableError(OSError):
    """Raised for a path that no file can be written to; the message gives the path and the reason."""


@contextmanager
def inputs_kept() -> Iterator[None]:
    """Protect the files that `read_by_command` names within the block from being written until the block ends.

    Yields
    ------
    None
        Control to the block.
    """
    token = _inputs.set([])
    try:
        yield
    finally:
        _inputs.reset(token)


def read_by_command(*paths: FilePath) -> None:
    """Name files that the running command reads; without an open `inputs_kept` nothing happens.

    Parameters
    ----------
    *paths : str or Path
        Files that must not be overwritten.
    """
    kept = _inputs.get()
    if kept is not None:
        kept.extend(Path(path) for path in paths)


def open_descriptor(path: FilePath) -> int | None:
    """Return the descriptor of this process that a path such as /dev/stdout names.

    Parameters
    ----------
    path : str or Path
        Path to resolve; symbolic links are followed.

    Returns
    -------
    int or None
        Number of the descriptor; None for any other path.
    """
    place = Path(path).absolute()
    for _ in range(MAX_LINKS):
        folder = _followed(place.parent)
        if place.name.isdecimal() and re.fullmatch(OPEN_FILES.format(pid=os.getpid()), str(folder)):
            return int(place.name)
        link = folder / place.name
        if not link.is_symlink():
            return None
        place = folder / link.readlink()
    return None


def obstacle(path: FilePath) -> str | None:
    """Return the reason why no file can be written to a path.

    Parameters
    ----------
    path : str or Path
        Path of the file.

    Returns
    -------
    str or None
        Reason in a few words; None if a file can be written.
    """
    descriptor = open_descriptor(path)
    try:
        status = Path(path).stat() if descriptor is None else os.fstat(descriptor)
    except FileNotFoundError:
        return _folder_obstacle(Path(path).parent) or _folder_obstacle(_followed(path).parent)
    except OSError as fault:
        return fault.strerror or str(fault)
    if stat.S_ISDIR(status.st_mode):
        return "it is a folder, not a file"
    if descriptor is not None:
        import fcntl

        reads_only = fcntl.fcntl(descriptor, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY
        return "it is open for reading only" if reads_only else None
    if stat.S_ISSOCK(status.st_mode):
        return "it is a socket, not a file"
    if _is_input(status):
        return "this command reads it, and inputs are never overwritten; name another file"
    return None if os.access(path, os.W_OK) else os.strerror(errno.EACCES)


def _folder_obstacle(folder: Path) -> str | None:
    if not folder.exists():
        return f"there is no folder {folder}; create it first"
    if not folder.is_dir():
        return f"{folder} is not a folder"
    return None if os.access(folder, os.W_OK | os.X_OK) else f"the folder {folder} cannot be written to"


def _is_input(status: os.stat_result) -> bool:
    if not stat.S_ISREG(status.st_mode):
        return False
    for path in _inputs.get() or ():
        with suppress(OSError):
            if os.path.samestat(path.stat(), status):
                return True
    return False


def _followed(path: FilePath) -> Path:
    return Path(os.path.realpath(path))


@contextmanager
def written_whole(path: FilePath) -> Iterator[Path]:
    """Provide a temporary path whose content replaces the file when the block ends without an exception.

    A killed process leaves at most a hidden temporary file; a regular file holds either its old content or the whole
    new one. Parent folders are not made.

    Parameters
    ----------
    path : str or Path
        File to write.

    Yields
    ------
    Path
        Temporary file to write to.

    Raises
    ------
    UnwritableError
        Before the block, if the path cannot be written.
    OSError
        If a write fails.
    """
    if reason := obstacle(path):
        raise UnwritableError(f"{path}: cannot be written ({reason})")
    descriptor, target = open_descriptor(path), _followed(path)
    status = target.stat() if descriptor is None and target.exists() else None
    replaced = descriptor is None and (status is None or stat.S_ISREG(status.st_mode))
    if replaced and os.access(target.parent, os.W_OK | os.X_OK):
        with _beside(target) as temporary:
            yield temporary
            _flush(temporary)
            _take_place(temporary, target, status)
    else:
        with tempfile.TemporaryDirectory(prefix="antinode-") as folder:
            temporary = Path(folder, f"output{PART}")
            yield temporary
            _write_through(temporary, os.dup(descriptor) if descriptor is not None else _opened(path))


@contextmanager
def _beside(target: Path) -> Iterator[Path]:
    temporary = target.with_name(f".{secrets.token_hex(4)}{PART}")
    try:
        yield temporary
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _flush(path: Path) -> None:
    """Put a file, or the names in a folder, on the disc."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _take_place(temporary: Path, target: Path, old: os.stat_result | None) -> None:
    if old is not None:
        with suppress(OSError):  # another's file, which only the administrator may give back
            os.chown(temporary, old.st_uid, old.st_gid)
        temporary.chmod(stat.S_IMODE(old.st_mode))
    try:
        temporary.replace(target)
    except OSError:
        if old is None:
            raise
        _write_through(temporary, _opened(target))  # a mount point, or another's file in a sticky folder
        return
    _flush(target.parent)


def _opened(path: FilePath) -> int:
    return os.open(path, os.O_WRONLY | os.O_TRUNC | os.O_NOCTTY | os.O_CLOEXEC)


def _write_through(temporary: Path, descriptor: int) -> None:
    sys.stdout.flush()  # what was printed comes first where both go the same way
    with temporary.open("rb") as source, open(descriptor, "wb") as sink:
        shutil.copyfileobj(source, sink)


# -- standard output ---------------------------------------------------------------------------------------------------


def silence_kernel() -> None:
    """Remove every printer of the kernel's default messenger; its faults still come back as return values."""
    from OCP.Message import Message

    messenger = Message.DefaultMessenger_s()
    while messenger.Printers().Size():
        messenger.RemovePrinters(messenger.Printers().First().DynamicType())
