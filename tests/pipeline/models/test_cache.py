"""What lies in a cache is believed only where every bit of it is what was written under its name."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from pipeline.models.cell_cache import SUFFIX, ArrayCache, Cache

CONTENT = b"stiffness"


def the_file(folder: Path) -> Path:
    (path,) = folder.glob(f"*{SUFFIX}")
    return path


def test_what_was_kept_comes_back(tmp_path: Path) -> None:
    cache = Cache(tmp_path / "made")
    assert cache.read("cell") is None
    cache.write("cell", CONTENT)
    assert Cache(tmp_path / "made").read("cell") == CONTENT


def test_every_flipped_bit_makes_a_file_absent(tmp_path: Path) -> None:
    cache = Cache(tmp_path)
    cache.write("cell", CONTENT)
    path = the_file(tmp_path)
    whole = path.read_bytes()
    for bit in range(8 * len(whole)):
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        assert cache.read("cell") is None, bit
    path.write_bytes(whole)
    assert cache.read("cell") == CONTENT


def test_a_torn_a_longer_and_a_renamed_file_are_absent(tmp_path: Path) -> None:
    cache = Cache(tmp_path)
    cache.write("cell", CONTENT)
    path = the_file(tmp_path)
    whole = path.read_bytes()
    path.with_name(f"other{SUFFIX}").write_bytes(whole)
    assert cache.read("other") is None
    for content in (b"", whole[:-1], whole[:20], whole + b"\0", CONTENT):
        path.write_bytes(content)
        assert cache.read("cell") is None


def test_arrays_come_back_to_the_last_digit(tmp_path: Path) -> None:
    cache = ArrayCache(tmp_path)
    arrays = {"stiffness": np.random.default_rng(1).normal(size=(3, 4)), "labels": np.array(["G", "X"])}
    cache.keep("cell", arrays)
    kept = cache.load("cell")
    assert kept is not None and kept.keys() == arrays.keys()
    assert all(np.array_equal(kept[name], arrays[name]) for name in arrays)
    path = the_file(tmp_path)
    path.write_bytes(path.read_bytes()[:-40])
    assert cache.load("cell") is None and cache.load("none") is None


def test_objects_are_never_kept(tmp_path: Path) -> None:
    with pytest.raises(ValueError):
        ArrayCache(tmp_path).keep("cell", {"code": np.array([{}], dtype=object)})


@pytest.mark.skipif(os.name != "posix", reason="links of POSIX")
def test_a_folder_that_cannot_be_made_is_no_fault(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    cache = Cache(tmp_path / "taken" / "cells")
    cache.write("cell", CONTENT)
    assert cache.read("cell") is None
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    Cache(loop).write("cell", CONTENT)
    assert Cache(loop).read("cell") is None


def test_the_longest_unused_files_are_removed_those_of_earlier_versions_too(tmp_path: Path) -> None:
    Cache(tmp_path).write("size", CONTENT)
    size = the_file(tmp_path).stat().st_size
    the_file(tmp_path).unlink()
    (tmp_path / "old.npz").write_bytes(b"x" * size)
    os.utime(tmp_path / "old.npz", (1.0, 1.0))
    cache = Cache(tmp_path, max_bytes=3 * size)
    for number, name in enumerate(("first", "second", "third")):
        cache.write(name, CONTENT)
        os.utime(tmp_path / f"{name}{SUFFIX}", (1000.0 + number, 1000.0 + number))
    assert not (tmp_path / "old.npz").exists()
    assert cache.read("first") is not None  # used now
    cache.write("fourth", CONTENT)
    assert cache.read("second") is None
    assert all(cache.read(name) is not None for name in ("first", "third", "fourth"))
    tight = Cache(tmp_path, max_bytes=1)
    tight.write("fifth", CONTENT)
    assert tight.read("fifth") is not None and len(list(tmp_path.iterdir())) == 1
