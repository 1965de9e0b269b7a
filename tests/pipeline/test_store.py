import errno
import os
from pathlib import Path

import numpy as np
import pytest

from pipeline import fingerprint, store
from pipeline.lock import StudyBusy, study_lock

PAYLOAD = {"name": "c", "value": 1.0}


def finished_case(folder: Path) -> dict:
    mark = fingerprint.current()
    store.begin(folder, PAYLOAD)
    store.save_arrays(folder, {"a": np.arange(5.0)})
    record = {"schema": 1, "case_id": folder.name, "status": "OK", "input_hash": fingerprint.input_hash(PAYLOAD)}
    record |= {"code_hash": mark.code_hash, "versions": mark.versions}
    store.finish(folder, record, {"seconds": {"total": 1.0}})
    return record


def why(folder: Path) -> str | None:
    return store.why_recompute(folder, PAYLOAD, fingerprint.current())


def test_a_finished_case_stands_and_reads_back(tmp_path: Path):
    folder = tmp_path / "c"
    assert why(folder) == "new"
    record = finished_case(folder)
    assert why(folder) is None
    assert store.read_record(folder) == record
    np.testing.assert_array_equal(store.load_arrays(folder)["a"], np.arange(5.0))


def test_the_same_arrays_give_the_same_bytes(tmp_path: Path):
    finished_case(tmp_path / "c")
    first = (tmp_path / "c" / store.ARRAYS).read_bytes()
    os.utime(tmp_path / "c" / store.ARRAYS, (0, 0))
    store.save_arrays(tmp_path / "c", {"a": np.arange(5.0)})
    assert (tmp_path / "c" / store.ARRAYS).read_bytes() == first


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("record.json", b'{"schema": 1, "case_', "record.json is unreadable"),
        ("record.json", b"", "record.json is unreadable"),
        ("record.json", b"[1]", "record.json is unreadable"),
        ("record.json", b'{"schema": 9, "case_id": "c"}', "record.json has schema 9"),
        ("arrays.npz", b"PK\x03\x04torn", "arrays.npz is unreadable"),
        ("arrays.npz", None, "arrays.npz is missing"),
        ("files.json", b"{", "files.json is unreadable"),
        ("record.json", None, "not finished before"),
    ],
)
def test_what_is_torn_is_named_and_recomputed(tmp_path: Path, name: str, content: bytes | None, said: str):
    folder = tmp_path / "c"
    finished_case(folder)
    (folder / name).unlink()
    if content is not None:
        (folder / name).write_bytes(content)
    assert said in why(folder)


def test_a_changed_byte_is_seen(tmp_path: Path):
    folder = tmp_path / "c"
    finished_case(folder)
    data = bytearray((folder / store.ARRAYS).read_bytes())
    data[len(data) // 2] ^= 1
    (folder / store.ARRAYS).write_bytes(data)
    assert "arrays.npz is unreadable" in why(folder)


def test_a_reader_keeps_the_old_file_whole(tmp_path: Path):
    path = tmp_path / "file"
    store.write_atomic(path, b"old")
    with path.open("rb") as reader:
        store.write_atomic(path, b"new")
        assert reader.read() == b"old"
    assert path.read_bytes() == b"new"


def test_changed_input_code_and_versions_are_told_apart(tmp_path: Path):
    folder = tmp_path / "c"
    finished_case(folder)
    mark = fingerprint.current()
    assert store.why_recompute(folder, {**PAYLOAD, "value": 2.0}, mark) == "its input changed"
    assert "sources" in store.why_recompute(folder, PAYLOAD, fingerprint.Fingerprint("0", mark.versions))
    older = fingerprint.Fingerprint(mark.code_hash, {**mark.versions, "numpy": "0"})
    assert "numpy" in store.why_recompute(folder, PAYLOAD, older)


def test_beginning_again_takes_the_old_proof_away_first(tmp_path: Path):
    folder = tmp_path / "c"
    finished_case(folder)
    (folder / f".arrays.npz.1{store.TEMPORARY}").write_bytes(b"half")
    store.begin(folder, PAYLOAD)
    assert sorted(path.name for path in folder.iterdir()) == ["input.json"]


def test_a_full_disk_is_named_and_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "file"
    store.write_atomic(path, b"old")

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(store.DiskFull, match="no space left"):
        store.write_atomic(path, b"new")
    assert path.read_bytes() == b"old"
    assert [item.name for item in tmp_path.iterdir()] == ["file"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full to write to")
def test_a_really_full_device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(Path, "with_name", lambda self, name: Path("/dev/full"))
    monkeypatch.setattr(Path, "unlink", lambda self, missing_ok=False: None)
    with pytest.raises(store.DiskFull):
        store.write_atomic(tmp_path / "file", b"new")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("case_id", ["", "..", "a/b", ".hidden", "a b", "x" * 201])
def test_ids_that_cannot_name_a_folder(tmp_path: Path, case_id: str):
    with pytest.raises(ValueError, match="case id"):
        store.case_folder(tmp_path, case_id)


def test_nan_becomes_null(tmp_path: Path):
    store.write_json(tmp_path / "x.json", {"a": float("nan"), "b": np.float32(2)})
    assert store.read_json(tmp_path / "x.json") == {"a": None, "b": 2.0}


def test_one_run_at_a_time(tmp_path: Path):
    with study_lock(tmp_path), pytest.raises(StudyBusy, match=f"process {os.getpid()}"), study_lock(tmp_path):
        pass
    with study_lock(tmp_path):
        pass
