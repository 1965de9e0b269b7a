"""One way to write: what stands at the place keeps its kind, its mode and its links; inputs keep their bytes."""

from __future__ import annotations

import os
import stat
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from geometry import files


def write(path: Path | str, data: bytes = b"new") -> None:
    with files.written_whole(path) as temporary:
        temporary.write_bytes(data)


@pytest.fixture
def reader(tmp_path: Path) -> Iterator[tuple[Path, list[bytes], threading.Thread]]:
    """A FIFO, and what is read from it until its writer closes it."""
    fifo, read = tmp_path / "fifo", []
    os.mkfifo(fifo)
    thread = threading.Thread(target=lambda: read.append(fifo.read_bytes()), daemon=True)
    thread.start()
    yield fifo, read, thread
    thread.join(timeout=20)


def test_a_fifo_is_written_through(reader: tuple[Path, list[bytes], threading.Thread]) -> None:
    fifo, read, thread = reader
    write(fifo)
    thread.join(timeout=20)
    assert read == [b"new"] and stat.S_ISFIFO(fifo.stat().st_mode)
    assert [path.name for path in fifo.parent.iterdir()] == ["fifo"]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may make a device node")
def test_a_device_stays_a_device(tmp_path: Path) -> None:
    """A null device of the test's own: whatever goes wrong here harms no other."""
    node = tmp_path / "null"
    try:
        os.mknod(node, stat.S_IFCHR | 0o666, os.makedev(1, 3))
        node.open("wb").close()
    except OSError as fault:
        pytest.skip(f"no device nodes here ({fault})")
    write(node)
    assert stat.S_ISCHR(node.stat().st_mode)


@pytest.mark.parametrize("there", [True, False])
def test_a_link_is_followed(tmp_path: Path, there: bool) -> None:
    (tmp_path / "elsewhere").mkdir()
    real, link = tmp_path / "elsewhere/real", tmp_path / "link"
    link.symlink_to("elsewhere/real")
    if there:
        real.write_bytes(b"old")
    write(link)
    assert link.is_symlink() and real.read_bytes() == b"new" and not real.is_symlink()


def test_mode_and_owner_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"old")
    path.chmod(0o640)
    if os.geteuid() == 0:
        os.chown(path, 12345, 12346)
    before = path.stat()
    write(path)
    after = path.stat()
    assert path.read_bytes() == b"new" and stat.S_IMODE(after.st_mode) == 0o640
    assert (after.st_uid, after.st_gid) == (before.st_uid, before.st_gid)
    assert after.st_ino != before.st_ino  # a reader of the old file keeps it whole


def test_a_new_file_has_the_mode_that_the_umask_leaves(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write(tmp_path / "file")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "file").stat().st_mode) == 0o640


def test_an_open_descriptor_is_written_where_it_stands(tmp_path: Path) -> None:
    """As a shell hands it on: `{ echo first; antinode ... --json /dev/fd/N; } > file`."""
    path = tmp_path / "file"
    with path.open("wb", buffering=0) as file:
        file.write(b"first ")
        write(f"/dev/fd/{file.fileno()}")
        file.write(b" last")
    assert path.read_bytes() == b"first new last"


def test_a_process_substitution_is_written_through() -> None:
    source, sink = os.pipe()
    write(f"/dev/fd/{sink}")
    os.close(sink)
    with os.fdopen(source, "rb") as read:
        assert read.read() == b"new"


def test_what_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"old")
    with pytest.raises(RuntimeError, match="halfway"), files.written_whole(path) as temporary:
        temporary.write_bytes(b"ne")
        raise RuntimeError("halfway")
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]


def test_obstacles_are_named_and_no_folder_is_made(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "loop").symlink_to("loop")
    for name, said in (("no/x", f"no folder {tmp_path / 'no'}"), (".", "is a folder"), ("file/x", "ot a directory")):
        with pytest.raises(files.UnwritableError, match=said):
            write(tmp_path / name)
    assert files.obstacle(tmp_path / "loop")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "loop"]
    with (tmp_path / "file").open("rb") as file:
        assert files.obstacle(f"/dev/fd/{file.fileno()}") == "it is open for reading only"


def test_an_input_is_never_written_whatever_its_name(tmp_path: Path) -> None:
    path, link = tmp_path / "case.toml", tmp_path / "link"
    path.write_bytes(b"old")
    link.symlink_to(path)
    os.link(path, tmp_path / "hard")
    with files.inputs_kept():
        files.read_by_command(path)
        for place in (path, link, tmp_path / "hard", tmp_path / "x/../case.toml"):
            (tmp_path / "x").mkdir(exist_ok=True)
            with pytest.raises(files.UnwritableError, match="never overwritten"):
                write(place)
        write(tmp_path / "other")
    assert path.read_bytes() == b"old"
    write(path)  # the command is over
    assert path.read_bytes() == b"new"


def test_a_file_that_cannot_be_replaced_is_written_in_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A mount point, or another's file in a sticky folder."""
    path = tmp_path / "file"
    path.write_bytes(b"old, and longer")

    def busy(*_: object) -> None:
        raise OSError(16, "Device or resource busy")

    monkeypatch.setattr(Path, "replace", busy)
    write(path)
    assert path.read_bytes() == b"new" and list(tmp_path.iterdir()) == [path]
