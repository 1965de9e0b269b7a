"""The firmware's core as a shared library for this machine, with checked invariants, called from Python by cffi."""

from __future__ import annotations

import atexit
import hashlib
import os
import re
import shutil
import stat
import subprocess
import sys
import sysconfig
import tempfile
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

HOST = Path(__file__).parent
CORE = HOST.parent / "core"
PARTS = (CORE, CORE / "single", CORE / "six")
PLACES = [f"-I{part}" for part in PARTS]
NO_LIBRARY = HOST / "headers"
FLAGS = ("-std=c11", "-O2", "-ffreestanding", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-DAN_CHECKED")


class NoCompiler(RuntimeError):
    """Neither a C compiler nor zig is installed."""


def compiler() -> list[str]:
    """Return the command of a C compiler for this machine: CC, cc, gcc, clang, or zig from pip. Raises NoCompiler."""
    for name in (os.environ.get("CC", ""), "cc", "gcc", "clang"):
        if name and shutil.which(name):
            return [name]
    if find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc"]
    raise NoCompiler("no C compiler: install cc, or zig with `pip install ziglang`")


def declarations(command: list[str]) -> str:
    """Return the declarations of the core's headers, preprocessed for cffi."""
    core = sorted(path.name for path in CORE.rglob("an_*.h") if "static inline" not in path.read_text())
    text = "".join(f'#include "{name}"\n' for name in (*core, "rig.h"))
    done = subprocess.run(
        [*command, "-E", "-P", "-nostdinc", f"-I{NO_LIBRARY}", *PLACES, f"-I{HOST}", "-xc", "-"],
        input=text,
        capture_output=True,
        text=True,
        check=True,
    )
    return re.sub(r"_Static_assert\(.*?\);|(?<=extern )const(?= an_build)", "", done.stdout)


def build(command: list[str], flags: tuple[str, ...] = ()) -> Path:
    """Build the shared library, once for each state of the sources and flags, and return its path."""
    sources = [*sorted(CORE.rglob("*.c")), *sorted(HOST.glob("*.c"))]
    state = hashlib.sha256(repr((command, flags, sys.platform, sysconfig.get_platform())).encode())
    for path in sorted([*CORE.rglob("an_*.*"), *HOST.glob("rig.[ch]")]):
        state.update(path.read_bytes())
    library = _private_folder() / f"core-{state.hexdigest()[:16]}.so"
    if not library.exists():
        fresh = library.with_suffix(f".{os.getpid()}")
        subprocess.run(
            [*command, *FLAGS, *flags, *PLACES, "-shared", "-o", str(fresh), *map(str, sources), "-lm"], check=True
        )
        fresh.replace(library)
    return library


def _private_folder() -> Path:
    """Return a folder that only this user can write to: in the user's cache, or else a new temporary one."""
    try:
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "antinode", "host")
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.lstat()
        if stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o077:
            return folder
    except (OSError, RuntimeError):
        pass
    return _temporary_folder()


@cache
def _temporary_folder() -> Path:
    folder = tempfile.mkdtemp(prefix="antinode-host-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


@cache
def load(*flags: str) -> tuple[Any, Any]:
    """Load the core, built with additional compiler flags and those of ANTINODE_HOST_FLAGS.

    Returns
    -------
    tuple
        cffi's FFI object and the library.

    Raises
    ------
    NoCompiler
        If no C compiler is installed.
    """
    from cffi import FFI

    command = compiler()
    ffi = FFI()
    ffi.cdef(declarations(command))
    return ffi, ffi.dlopen(str(build(command, (*flags, *os.environ.get("ANTINODE_HOST_FLAGS", "").split()))))


class Supervised:
    """Base class for hosts of an application of either build, which is accessible as `app`."""

    app: Any

    @property
    def state(self) -> int:
        """State: IDLE, IDENTIFY, RUN or FAULT of firmware.protocol."""
        return int(self.app.base.supervisor.state)

    @property
    def faults(self) -> int:
        """Bits of the latched faults."""
        return int(self.app.base.supervisor.faults)
