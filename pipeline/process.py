"""Process set-up: signals that end it, and cache folders that libraries expect."""

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
# Cache folders of libraries: the variable that sets one, and its default.
CACHES = {
    "MPLCONFIGDIR": ("XDG_CONFIG_HOME", ".config", "matplotlib"),
    "XDG_CACHE_HOME": ("XDG_CACHE_HOME", ".cache", "ezdxf"),
}


@contextmanager
def terminable() -> Iterator[None]:
    """Turn SIGTERM and SIGHUP into KeyboardInterrupt in the block, like SIGINT, so that finished work is kept.

    Only the first one counts, since `timeout` and service managers send several. Signals that the parent ignores, as
    nohup does, stay ignored. Only a main thread can handle signals; elsewhere nothing changes.
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
    """Give every library whose cache folder cannot be written a temporary one, for this process and its children."""
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
    with suppress(OSError, RuntimeError):  # RuntimeError: the home folder is unknown
        place = place.expanduser()
        nearest = next(each for each in (place, *place.parents) if each.exists())
        return nearest.is_dir() and os.access(nearest, os.W_OK | os.X_OK)
    return False
