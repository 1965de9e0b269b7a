"""This process among others: signals that end it, and the folders that libraries expect to keep caches in."""

from __future__ import annotations

import atexit
import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import NoReturn

ENDING = ("SIGTERM", "SIGHUP")
# Where a library keeps what it need not find again: the variable that moves it, and its place when that is not set.
CACHES = {
    "MPLCONFIGDIR": ("XDG_CONFIG_HOME", ".config", "matplotlib"),
    "XDG_CACHE_HOME": ("XDG_CACHE_HOME", ".cache", "ezdxf"),
}


@contextmanager
def terminable() -> Iterator[None]:
    """SIGTERM and SIGHUP are KeyboardInterrupt within the block, as SIGINT is, so that what was finished is kept.

    The first one alone counts: `timeout` and service managers send several. Those that the parent has this process
    ignore, as nohup does, stay ignored. Only a main thread can listen to signals; elsewhere nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    names = [each for name in ENDING if (each := getattr(signal, name, None))]
    before = {each: signal.getsignal(each) for each in names if signal.getsignal(each) is signal.SIG_DFL}
    for each in before:
        signal.signal(each, _interrupt)
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def lend_cache_folders() -> None:
    """A temporary folder, for this process and its children, to every library whose own place cannot be written."""
    missing = [
        variable for variable, (base, hidden, name) in CACHES.items() if not _usable(variable, base, hidden, name)
    ]
    if not missing:
        return
    folder = tempfile.mkdtemp(prefix="antinode-caches-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ.update(dict.fromkeys(missing, folder))


def _usable(variable: str, base: str, hidden: str, name: str) -> bool:
    if variable != base and os.environ.get(variable):
        place = Path(os.environ[variable])
    else:
        place = Path(os.environ.get(base) or f"~/{hidden}", name)
    with suppress(OSError, RuntimeError):  # RuntimeError: no home folder is known
        place = place.expanduser()
        nearest = next(each for each in (place, *place.parents) if each.exists())
        return nearest.is_dir() and os.access(nearest, os.W_OK | os.X_OK)
    return False
