import errno
import io
import json
import os
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from pipeline.batch.runner import StudyBusy, study_lock
from pipeline.board import export
from pipeline.records import store

PAYLOAD = {"name": "c", "value": 1.0}


def finished_case(folder: Path) -> dict:
    mark = store.current_fingerprint()
    store.begin(folder, PAYLOAD)
    store.save_arrays(folder, {"a": np.arange(5.0)})
    record = {
        "schema": store.SCHEMA,
        "case_id": folder.name,
        "status": "OK",
        "input_hash": store.input_hash(PAYLOAD),
    }
    record |= {"code_hash": mark.code_hash, "versions": mark.versions}
    store.finish(folder, record, {"seconds": {"total": 1.0}})
    return record


def why(folder: Path) -> str | None:
    return store.why_recompute(folder, PAYLOAD, store.current_fingerprint())


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


def flipped_bits(data: bytes, step: int) -> Iterator[bytes]:
    for place in range(0, len(data), step):
        for bit in (0, 1, 4):
            yield data[:place] + bytes([data[place] ^ (1 << bit)]) + data[place + 1 :]


@pytest.mark.parametrize("name", [store.RECORD, store.MANIFEST])
def test_no_flipped_bit_changes_what_is_read(tmp_path: Path, name: str):
    """Every third byte, three of its bits: the record is refused, or reads as it was (a blank for another)."""
    folder = tmp_path / "c"
    record = finished_case(folder)
    whole = (folder / name).read_bytes()
    refused = 0
    for data in flipped_bits(whole, 3):
        (folder / name).write_bytes(data)
        try:
            assert store.read_record(folder) == record
            store.load_arrays(folder)
        except store.BadRecord:
            refused += 1
            assert why(folder)
    assert refused > len(whole) / 2


def edited(folder: Path, name: str, edit: Callable[[dict], object]) -> None:
    stored = json.loads((folder / name).read_text())
    edit(stored)
    (folder / name).write_text(json.dumps(stored))


@pytest.mark.parametrize(
    ("name", "edit"),
    [
        (store.RECORD, lambda stored: stored.update(status="WARNING")),
        (store.RECORD, lambda stored: stored.update(target={"confinement_db": 99.0})),
        (store.RECORD, lambda stored: stored.update(target=float("inf"))),
        (store.RECORD, lambda stored: stored.pop("proof")),
        (store.RECORD, lambda stored: stored.update(proof=None)),
        (store.RECORD, lambda stored: stored.update(case_id="another")),
        (store.MANIFEST, dict.clear),
        (store.MANIFEST, lambda stored: stored.pop(store.ARRAYS)),
        (store.MANIFEST, lambda stored: stored.update(x=3)),
        (store.MANIFEST, lambda stored: stored[store.ARRAYS].update(sha256="0")),
    ],
)
def test_an_edited_record_or_list_is_computed_again_and_not_read(tmp_path: Path, name: str, edit: Callable):
    folder = tmp_path / "c"
    finished_case(folder)
    edited(folder, name, edit)
    assert why(folder)
    with pytest.raises(store.BadRecord, match=r"record\.json"):
        store.read_record(folder)
    with pytest.raises(store.BadRecord):
        store.load_arrays(folder)


def test_a_record_of_an_earlier_version_is_computed_again(tmp_path: Path):
    folder = tmp_path / "c"
    finished_case(folder)
    edited(folder, store.RECORD, lambda stored: stored.pop("proof"))
    assert why(folder) == "record.json has no checksum: it was written by an earlier version"


def test_arrays_of_another_case_do_not_stand(tmp_path: Path):
    for name in ("c", "other", "none"):
        finished_case(tmp_path / name)
    store.save_arrays(tmp_path / "other", {"a": np.zeros(5)})
    (tmp_path / "none" / store.ARRAYS).unlink()
    record = store.read_record(tmp_path / "none")
    store.seal(tmp_path / "none", record)
    assert store.load_arrays(tmp_path / "none") == {}
    for name in ("c", "none"):
        (tmp_path / name / store.ARRAYS).write_bytes((tmp_path / "other" / store.ARRAYS).read_bytes())
        edited(tmp_path / name, store.MANIFEST, dict.clear) if name == "c" else None
        assert why(tmp_path / name)
        with pytest.raises(store.BadRecord):
            store.load_arrays(tmp_path / name)


def test_a_file_that_is_not_the_listed_one_is_not_read(tmp_path: Path):
    folder = tmp_path / "c"
    finished_case(folder)
    assert store.read_listed(folder, store.INPUT) == PAYLOAD
    store.write_json(folder / store.INPUT, {**PAYLOAD, "value": 2.0})
    with pytest.raises(store.BadRecord, match=r"input\.json"):
        store.read_listed(folder, store.INPUT)


@pytest.mark.slow
def test_arrays_that_cannot_be_read_raise_nothing_else(tmp_path: Path):
    """Random bytes in the file, the proof made anew over them: zlib.error, MemoryError and their like are BadRecord."""
    folder, random = tmp_path / "c", np.random.default_rng(5)
    record = finished_case(folder)
    store.save_arrays(folder, {"a": random.normal(size=60), "b": np.arange(40)})
    whole = np.frombuffer((folder / store.ARRAYS).read_bytes(), np.uint8)
    refused = 0
    for _ in range(300):
        torn = whole.copy()
        torn[random.integers(0, len(torn), 3)] = random.integers(0, 256, 3)
        (folder / store.ARRAYS).write_bytes(torn.tobytes())
        store.seal(folder, record)
        try:
            store.load_arrays(folder)
        except store.BadRecord:
            refused += 1
    assert refused > 100


def test_a_header_of_many_gigabytes_is_refused(tmp_path: Path):
    folder = tmp_path / "c"
    record = finished_case(folder)
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (1 << 50,)})
    with zipfile.ZipFile(folder / store.ARRAYS, "w") as file:
        file.writestr("a.npy", header.getvalue())
    store.seal(folder, record)
    with pytest.raises(store.BadRecord, match=r"arrays\.npz is unreadable"):
        store.load_arrays(folder)


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
    mark = store.current_fingerprint()
    assert store.why_recompute(folder, {**PAYLOAD, "value": 2.0}, mark) == "its input changed"
    assert "sources" in store.why_recompute(folder, PAYLOAD, store.Fingerprint("0", mark.versions))
    older = store.Fingerprint(mark.code_hash, {**mark.versions, "numpy": "0"})
    assert "numpy" in store.why_recompute(folder, PAYLOAD, older)


def test_the_list_of_files_has_results_alone(tmp_path: Path):
    """Neither itself, times and messages, which differ from run to run, nor what a killed run left."""
    folder = tmp_path / "c"
    finished_case(folder)
    for name in (".arrays.npz.1.part", store.RUN_LOG, "plate.step"):
        (folder / name).write_bytes(b"x")
    assert {store.RECORD, store.TIMING, store.MANIFEST} <= {path.name for path in folder.iterdir()}
    assert set(store.manifest(folder)) == {store.INPUT, store.ARRAYS, "plate.step"}


def test_beginning_again_takes_the_old_proof_away_first(tmp_path: Path):
    folder = tmp_path / "c"
    finished_case(folder)
    (folder / f".arrays.npz.1{store.TEMPORARY}").write_bytes(b"half")
    (folder / "notes.txt").write_text("of the user")
    for path in (*export.places(folder, "mode_table"), *export.places(folder, "travelling_wave")):
        path.write_bytes(b"of another design")
    store.begin(folder, PAYLOAD)
    assert sorted(path.name for path in folder.iterdir()) == ["input.json", "notes.txt"]


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


@pytest.mark.parametrize("text", ["[" * 100_000, r'{"\ud800": 1}', r'["\uDEAD"]', "NaN"])
def test_json_that_no_file_of_ours_holds_is_a_bad_record(text, tmp_path):
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(store.BadRecord, match="unreadable"):
        store.read_json(tmp_path / "x.json")


def test_a_pair_of_surrogates_is_a_letter(tmp_path):
    (tmp_path / "x.json").write_text(r'["\ud83d\ude00"]')
    assert store.read_json(tmp_path / "x.json") == ["\U0001f600"]


def test_a_sealed_object_is_believed_bit_by_bit(tmp_path):
    path = tmp_path / "x.json"
    store.write_sealed(path, {"cases": [1, 2]})
    whole = path.read_bytes()
    assert store.read_sealed(path)["cases"] == [1, 2]
    for bit in range(8 * len(whole)):
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        try:
            kept = store.read_sealed(path)
        except store.BadRecord:
            continue
        assert kept["cases"] == [1, 2]  # spacing alone


@pytest.mark.parametrize("count", [200, pytest.param(2000, marks=pytest.mark.slow)])
def test_a_flipped_bit_of_a_case_is_recomputed_or_changes_nothing(count, tmp_path):
    """Bits drawn over every file of a finished case."""
    folder = tmp_path / "case"
    record = finished_case(folder)
    mark, draw = store.current_fingerprint(), np.random.default_rng(5)
    names = sorted(path.name for path in folder.iterdir() if path.name not in (store.TIMING, store.RUN_LOG))
    whole = {name: (folder / name).read_bytes() for name in names}
    recomputed = 0
    for _ in range(count):
        name = names[draw.integers(len(names))]
        damaged, bit = bytearray(whole[name]), int(draw.integers(8 * len(whole[name])))
        damaged[bit // 8] ^= 1 << bit % 8
        (folder / name).write_bytes(damaged)
        if store.why_recompute(folder, PAYLOAD, mark) is None:
            kept = store.read_record(folder)
            assert {key: kept[key] for key in record} == store.plain(record), (name, bit)
            assert np.array_equal(store.load_arrays(folder)["a"], np.arange(5.0))
        else:
            recomputed += 1
        (folder / name).write_bytes(whole[name])
    assert recomputed > 0.75 * count
