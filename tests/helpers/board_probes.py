"""Probes of an emulated board for tests, beyond its serial line, pins and button."""

from __future__ import annotations

import ctypes
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from unicorn import UC_HOOK_CODE, UC_HOOK_EDGE_GENERATED, UC_HOOK_MEM_WRITE, Uc
from unicorn.arm_const import UC_ARM_REG_LR, UC_ARM_REG_SP

from firmware import build as builder
from firmware import image
from firmware.emulate.board import RAM, RAM_BYTES, EmulatedBoard
from firmware.emulate.images import ADC_SR, OVERRUN, SCAN_LEFT, EmulatedSix
from firmware.image import Elf


def lose_stack(board: EmulatedBoard) -> None:
    """Move the stack pointer outside the stack, so that its next use faults."""
    board.uc.reg_write(UC_ARM_REG_SP, RAM + RAM_BYTES - 64)
    board.interrupt_unexpectedly()


def stack_pointer(board: EmulatedBoard) -> int:
    """Address at which the main loop's stack ends while it waits."""
    return int(board.uc.reg_read(UC_ARM_REG_SP))


def peek(board: EmulatedBoard, address: int, length: int) -> bytes:
    """Bytes of shared memory."""
    return ctypes.string_at(board._address(address), length)


def hear_earlier(board: EmulatedBoard, seconds: float, window_s: float) -> None:
    """Date the last message of the host back by a time, so that the test need not wait."""
    supervisor = board.app.base.supervisor
    supervisor.heard = (supervisor.heard - round(seconds / window_s)) % 2**32


def push_button(board: EmulatedBoard) -> None:
    """Press and release the button, each for longer than its contact bounces."""
    for pressed in (True, False):
        board.press(pressed)
        board.run(22e-3)


def overrun(board: EmulatedSix) -> None:
    """Simulate an ADC overrun: ADC and DMA stop until both are set up again (RM0390, "Using the DMA")."""
    board.word(ADC_SR).value |= OVERRUN
    board.word(SCAN_LEFT).value = 3


def count_instructions(board: EmulatedBoard, run: Callable[[], Any], *routines: str) -> dict[str, Counter[int]]:
    """Counts of each routine's instructions from entry to return, calls included, while something runs."""
    entries = {board.symbol(name): name for name in routines}
    counts: dict[str, Counter[int]] = {name: Counter() for name in routines}
    count, back, inside = 0, 0, ""

    def each(uc: Uc, address: int, *_: Any) -> None:
        nonlocal count, back, inside
        if inside and address == back:
            counts[inside][count] += 1
            inside = ""
        if address in entries:
            count, back, inside = 0, uc.reg_read(UC_ARM_REG_LR) & ~1, entries[address]
        count += 1

    board.uc.ctl_flush_tb()  # type: ignore[attr-defined]  # code translated earlier has no hook
    hook = board.uc.hook_add(UC_HOOK_CODE, each)
    try:
        run()
    finally:
        board.uc.hook_del(hook)
        board.uc.ctl_flush_tb()  # type: ignore[attr-defined]
    return counts


def record_writes(board: EmulatedBoard, run: Callable[[], Any], *ranges: tuple[int, int]) -> list[tuple[int, int, int]]:
    """Writes of the image to ranges of addresses while something runs: (instructions so far, address, value)."""
    writes: list[tuple[int, int, int]] = []
    count = 0

    def each(*_: Any) -> None:
        nonlocal count
        count += 1

    def write(_: Uc, __: int, address: int, ___: int, value: int, ____: Any) -> None:
        writes.append((count, address, value))

    hooks = [board.uc.hook_add(UC_HOOK_MEM_WRITE, write, begin=low, end=high - 1) for low, high in ranges]
    hooks.append(board.uc.hook_add(UC_HOOK_CODE, each))
    board.uc.ctl_flush_tb()  # type: ignore[attr-defined]
    run()
    for hook in hooks:
        board.uc.hook_del(hook)
    return writes


def count_translations(board: EmulatedBoard, seconds: float) -> int:
    """Number of code blocks that the emulator translates while a board runs, except those at the start of a 4 KB page.

    What runs on from the page before is translated anew each time, wherever a compiler's layout puts it.
    """
    count = 0

    def each(_: Any, piece: Any, *__: Any) -> None:
        nonlocal count
        count += piece.pc % 4096 != 0

    hook = board.uc.hook_add(UC_HOOK_EDGE_GENERATED, each)
    board.run(seconds)
    board.uc.hook_del(hook)
    return count


def routines_of_the_board(header: str, variant: str) -> set[str]:
    """Names of all functions, static ones included, in the board's sources of a build."""
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
                here = [one for one in Elf.read(target).all_symbols if one["st_shndx"] != "SHN_UNDEF"]
                names |= {one.name for one in here if one["st_info"]["type"] == "STT_FUNC"}
    return names


class BranchRecorder:
    """Both paths of each conditional branch in some routines, and those that were executed."""

    def __init__(self, elf: Elf, routines: set[str]) -> None:
        self.code = image.Code(elf)
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
            except image.Unbounded:
                continue
            nexts = [*step.targets, *([at + step.size] if step.falls_through else [])]
            if step.targets and step.falls_through:
                self.ways |= {(at, to) for to in nexts}
            waiting += nexts

    def watch(self, board: EmulatedBoard) -> None:
        """Record the branches of a board from now on."""
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
        """Fraction of the paths that were executed."""
        return len(self.ways & self.gone) / len(self.ways)
