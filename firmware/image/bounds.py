"""Longest path through a routine of an image, in instructions: an upper bound for every possible execution.

`python -m firmware.image.bounds FILE.elf an_fast_tick ...` derives the control flow from the Thumb-2 code: branches,
calls (whose own longest paths are added) and returns. Every instruction counts as one. A routine with a loop has no
bound.
"""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from typing import NamedTuple

from firmware.image.elf import Elf


class Step(NamedTuple):
    """Instruction: size in bytes, branch targets, whether it can fall through, and the routine it calls."""

    size: int
    targets: tuple[int, ...] = ()
    falls_through: bool = True
    call: int | None = None


class Unbounded(ValueError):
    """The routine has a loop, or a jump whose target depends on data."""


def _signed(value: int, bits: int) -> int:
    return value - (1 << bits) if value >> (bits - 1) else value


def _narrow(word: int, at: int, in_block: bool) -> Step:
    if word >> 12 == 0b1101 and word >> 8 & 0xF < 14:
        return Step(2, (at + 4 + 2 * _signed(word & 0xFF, 8),))
    if word >> 11 == 0b11100:
        return Step(2, (at + 4 + 2 * _signed(word & 0x7FF, 11),), in_block)
    if word & 0xF500 == 0xB100:  # cbz, cbnz
        return Step(2, (at + 4 + 2 * ((word >> 3 & 0x1F) | (word >> 4 & 0x20)),))
    if word & 0xFF87 == 0x4700 or word & 0xFF00 == 0xBD00:  # bx, pop {..., pc}
        return Step(2, (), in_block)
    if word & 0xFF87 == 0x4780 or word & 0xFF87 == 0x4687:  # blx, mov pc
        raise Unbounded(f"{at:#x}: a call or jump through a register")
    return Step(2)


def _wide(high: int, low: int, at: int, in_block: bool) -> Step:
    if high >> 11 == 0b11110 and low >> 15:
        sign, j1, j2 = high >> 10 & 1, low >> 13 & 1, low >> 11 & 1
        if low >> 12 & 1 or low >> 14 & 1:  # bl, b.w
            i1, i2 = 1 - (j1 ^ sign), 1 - (j2 ^ sign)
            offset = _signed(sign << 24 | i1 << 23 | i2 << 22 | (high & 0x3FF) << 12 | (low & 0x7FF) << 1, 25)
            if low >> 14 & 1:
                return Step(4, call=at + 4 + offset)
            return Step(4, (at + 4 + offset,), in_block)
        if high >> 7 & 7 != 7:  # b<c>.w
            offset = _signed(sign << 20 | j2 << 19 | j1 << 18 | (high & 0x3F) << 12 | (low & 0x7FF) << 1, 21)
            return Step(4, (at + 4 + offset,))
    if high == 0xE8BD and low >> 15:  # pop {..., pc}
        return Step(4, (), in_block)
    if high & 0xFFF0 == 0xF850 and low >> 12 == 15:  # ldr pc
        return Step(4, (), in_block)
    if high == 0xE8DF and low & 0xFFE0 == 0xF000:  # tbb, tbh
        raise Unbounded(f"{at:#x}: a jump through a table")
    return Step(4)


class Code:
    """Instructions of an image."""

    def __init__(self, elf: Elf) -> None:
        self.elf = elf
        self.text = elf.segments[0]
        self.longest = cache(self._longest)

    def _half(self, at: int) -> int:
        offset = at - self.text.address
        return int.from_bytes(self.text.data[offset : offset + 2], "little")

    def step(self, at: int, in_block: bool) -> Step:
        """Decode the instruction at an address; in_block means that an IT block makes it conditional."""
        high = self._half(at)
        if high >> 11 in (0b11101, 0b11110, 0b11111):
            return _wide(high, self._half(at + 2), at, in_block)
        return _narrow(high, at, in_block)

    def block_left(self, at: int, left: int) -> int:
        """Return how many of the following instructions are conditional, given the number before this one."""
        high = self._half(at)
        if high & 0xFF00 == 0xBF00 and high & 0xF:
            return 4 - (high & -high).bit_length() + 1
        return max(left - 1, 0)

    def _longest(self, entry: int) -> int:
        result: dict[tuple[int, int], int] = {}
        under_way: set[tuple[int, int]] = set()

        def walk(at: int, left: int) -> int:
            place = at, left
            if place in result:
                return result[place]
            if place in under_way:
                raise Unbounded(f"{at:#x}: a loop")
            under_way.add(place)
            step = self.step(at, left > 0)
            after = self.block_left(at, left)
            paths = [walk(target, 0) for target in step.targets]
            if step.falls_through:
                paths.append(walk(at + step.size, after))
            called = self.longest(step.call) if step.call is not None else 0
            under_way.discard(place)
            result[place] = 1 + called + max(paths, default=0)
            return result[place]

        sys.setrecursionlimit(20000)
        return walk(entry, 0)


def bound(image: Path, routine: str) -> int:
    """Count the instructions on the longest path from a routine's entry to its return, including calls.

    Parameters
    ----------
    image : Path
        ELF file.
    routine : str
        Name of the routine.

    Returns
    -------
    int

    Raises
    ------
    Unbounded
        If the routine has a loop or a computed jump.
    KeyError
        If the image has no such routine.
    """
    elf = Elf.read(image)
    return Code(elf).longest(elf.symbols[routine].address)


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit code."""
    if len(arguments) < 2:
        print("usage: python -m firmware.image.bounds FILE.elf ROUTINE ...", file=sys.stderr)
        return 2
    for name in arguments[1:]:
        try:
            print(f"{name}: {bound(Path(arguments[0]), name)}")
        except (Unbounded, KeyError, OSError) as error:
            print(f"bounds: {name}: {error}", file=sys.stderr)
            return 3
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
