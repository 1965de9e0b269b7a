"""One run of a study at a time: a lock that ends with the process that holds it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from pipeline.errors import CommandError

LOCK = ".lock"


class StudyBusy(CommandError):
    """Another process is running this study."""

    exit_code = 2


@contextmanager
def study_lock(folder: Path) -> Iterator[None]:
    """Hold the study's lock. The kernel frees it when the process ends, so a killed run leaves no stale lock.

    Raises StudyBusy when another process holds it.
    """
    import fcntl

    folder.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = os.pread(descriptor, 200, 0).decode(errors="replace").strip() or "an unknown process"
            raise StudyBusy(
                f"{folder}: another run of this study is at work ({holder}); wait for it or end it"
            ) from error
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"process {os.getpid()}, since {datetime.now():%Y-%m-%d %H:%M:%S}\n".encode(), 0)
        yield
    finally:
        os.close(descriptor)
