"""How many branches of the board's code a set of runs on the emulated board takes.

A branch of the compiled code counts twice: once for each way it can go. The routines are those that the sources of
firmware/board define; what the compiler put into them from headers is theirs.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from unicorn import UC_HOOK_CODE

from firmware import build as builder
from firmware.emulate.board import EmulatedBoard
from firmware.image import bounds
from firmware.image.elf import Elf


def routines_of_the_board(header: str, variant: str) -> set[str]:
    """The names of all functions that the board's sources of a build define, static ones included."""
    _, command = builder.toolchain()
    names: set[str] = set()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "mode_table.h").write_text(header)
        parts = (builder.BOARD, builder.BOARD / variant)
        places = [f"-I{part}" for part in (builder.CORE, builder.CORE / variant, *parts, folder)]
        for part in parts:
            for source in sorted(part.glob("*.c")):
                target = folder / f"{source.stem}.o"
                options = [builder.optimised(source), *builder.LANGUAGE, *builder.SECTIONS, *places]
                builder.run([*command, *options, "-c", str(source), "-o", str(target)])
                names |= Elf.read(target).functions
    return names


class BranchRecorder:
    """Both ways of each conditional branch of some routines, and which of them were gone."""

    def __init__(self, elf: Elf, routines: set[str]) -> None:
        self.code = bounds.Code(elf)
        self.ways: set[tuple[int, int]] = set()
        self.ranges: list[tuple[int, int]] = []
        self.gone: set[tuple[int, int]] = set()
        for name in sorted(routines & set(elf.symbols)):
            symbol = elf.symbols[name]
            if symbol.size and symbol.address < builder.RAM_START:
                self.ranges.append((symbol.address, symbol.address + symbol.size))
                self._find_branches(symbol.address, symbol.address + symbol.size)
        self.branches = {at for at, _ in self.ways}

    def _find_branches(self, start: int, end: int) -> None:
        reached, waiting = set(), [start]
        while waiting:
            at = waiting.pop()
            if at in reached or not start <= at < end:
                continue
            reached.add(at)
            try:
                step = self.code.step(at, False)
            except bounds.Unbounded:
                continue
            nexts = [*step.targets, *([at + step.size] if step.falls_through else [])]
            if step.targets and step.falls_through:
                self.ways |= {(at, to) for to in nexts}
            waiting += nexts

    def watch(self, board: EmulatedBoard) -> None:
        """Records what a board does from now on."""
        last = 0

        def each(_: Any, address: int, *__: Any) -> None:
            nonlocal last
            if last in self.branches:
                self.gone.add((last, address))
            last = address

        board.uc.ctl_flush_tb()  # type: ignore[attr-defined]
        for start, end in self.ranges:
            board.uc.hook_add(UC_HOOK_CODE, each, begin=start, end=end - 1)

    @property
    def share(self) -> float:
        """Of the ways that were gone."""
        return len(self.ways & self.gone) / len(self.ways)
