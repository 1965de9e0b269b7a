"""The host library is loaded only from a folder that nobody else can write to."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from firmware import host


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "antinode" / "host"


def test_the_users_own_cache_is_private(cache: Path) -> None:
    assert host._private_folder() == cache
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o701])
def test_a_folder_that_others_may_enter_is_not_used(mode: int, cache: Path) -> None:
    cache.mkdir(parents=True)
    cache.chmod(mode)
    folder = host._private_folder()
    assert folder != cache and stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_a_link_and_another_users_folder_are_not_used(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache.parent.mkdir()
    cache.symlink_to(tmp_path, target_is_directory=True)
    assert host._private_folder() != cache
    cache.unlink()
    assert host._private_folder() == cache
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    assert host._private_folder() != cache
