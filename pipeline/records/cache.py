"""Files that can be computed again: each carries a digest of its name and its whole content, checked before it is read."""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from geometry import files

if TYPE_CHECKING:
    import numpy as np

MARK = b"antinode cache 1\n"
SUFFIX = ".kept"
DIGEST_BYTES = hashlib.sha256().digest_size


class Cache:
    """A folder of files by name.

    A file that is torn, damaged in any bit, renamed or written by another program counts as absent. Nothing is raised where the
    folder cannot be read or written: what is absent is computed.

    Parameters
    ----------
    folder : Path
        Where the files lie; made when the first one is written.
    max_bytes : int, optional
        Size of all files together, B; beyond it the longest unused ones are removed. None: no limit.
    """

    def __init__(self, folder: Path, max_bytes: int | None = None) -> None:
        self.folder, self.max_bytes = folder, max_bytes

    def read(self, name: str) -> bytes | None:
        """Return the content kept under a name, or None."""
        path = self._path(name)
        try:
            sealed = path.read_bytes()
        except OSError:
            return None
        content = memoryview(sealed)[len(MARK) + DIGEST_BYTES :]
        if sealed[: len(MARK) + DIGEST_BYTES] != _seal(name, content):
            return None
        with contextlib.suppress(OSError):
            os.utime(path)  # the last to be removed
        return bytes(content)

    def write(self, name: str, content: bytes) -> None:
        """Keep a content under a name; where the folder cannot be written it is computed again next time."""
        path = self._path(name)
        with contextlib.suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
            with files.written_whole(path) as temporary:
                temporary.write_bytes(_seal(name, content) + content)
            self._make_room(path)

    def read_arrays(self, name: str) -> dict[str, np.ndarray] | None:
        """Return the arrays kept under a name, or None."""
        import numpy as np

        content = self.read(name)
        if content is None:
            return None
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            return {key: file[key] for key in file.files}

    def write_arrays(self, name: str, arrays: Mapping[str, Any]) -> None:
        """Keep arrays under a name, as `write` does."""
        import numpy as np

        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **arrays)
        self.write(name, buffer.getvalue())

    def _make_room(self, newest: Path) -> None:
        """Remove the files longest unused until the rest fits, never the one just kept."""
        if self.max_bytes is None:
            return
        kept = sorted(((path.stat(), path) for path in self._files()), key=lambda pair: pair[0].st_mtime)
        total = sum(stat.st_size for stat, _ in kept)
        for stat, path in kept:
            if total <= self.max_bytes:
                return
            if path != newest:
                path.unlink(missing_ok=True)
                total -= stat.st_size

    def _files(self) -> list[Path]:
        """Files of this cache and of what earlier versions kept here."""
        return [path for path in self.folder.iterdir() if path.suffix in (SUFFIX, ".npz")]

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}{SUFFIX}"


def _seal(name: str, content: bytes | memoryview) -> bytes:
    digest = hashlib.sha256(f"{name}\n".encode())
    digest.update(content)
    return MARK + digest.digest()
