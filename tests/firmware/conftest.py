"""The firmware's core, compiled for this machine."""

from __future__ import annotations

import shutil
from typing import Any, NamedTuple

import pytest


class Core(NamedTuple):
    ffi: Any
    lib: Any


@pytest.fixture(scope="session")
def core() -> Core:
    pytest.importorskip("cffi", reason="cffi is not installed: pip install cffi")
    from firmware.host import NoCompiler, load

    try:
        return Core(*load())
    except NoCompiler as missing:
        pytest.skip(str(missing))


@pytest.fixture(scope="session")
def make_image(tmp_path_factory: pytest.TempPathFactory):
    """Builds an image with a table inside, once for each table."""
    from firmware import build as builder

    try:
        builder.toolchain()
    except builder.BuildError as missing:
        pytest.skip(str(missing))
    images: dict[tuple[bytes, str], builder.Image] = {}
    made: dict[tuple[str, ...], str] = {}
    run = builder.run

    def compiled(command: list[str]) -> None:
        """What no table is in is compiled once for each build."""
        *what, target = command
        if tuple(what) in made:
            shutil.copy(made[tuple(what)], target)
        else:
            run(command)
            made[tuple(what)] = target

    def make(table: bytes, variant: str = "single") -> builder.Image:
        if (table, variant) not in images:
            folder = tmp_path_factory.mktemp("image")
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(builder, "run", compiled)
                images[table, variant] = builder.build(table, folder, variant)
        return images[table, variant]

    return make
