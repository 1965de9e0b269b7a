"""The two controllers of the F446 that answer back: the clock's and the flash memory's."""

from __future__ import annotations

from collections.abc import Callable

SECTOR_BYTES = 16 * 1024
ERASE_S = 0.25  # typical for 16 KB; data sheet: at most 0.5 s
WORD_S = 16e-6


class Clock:
    """What is switched on becomes ready, unless it is dead."""

    CR, CFGR, CSR = 0x00, 0x08, 0x74
    READY = ((1 << 16, 1 << 17), (1 << 24, 1 << 25))  # crystal, PLL: on, ready

    def __init__(self, dead: bool, watchdog: bool) -> None:
        self.dead = dead
        self.words: dict[int, int] = {self.CSR: watchdog << 29}

    def read(self, offset: int) -> int:
        value = self.words.get(offset, 0)
        if offset == self.CR and not self.dead:
            for on, ready in self.READY:
                value |= ready if value & on else 0
        if offset == self.CFGR:
            value |= (value & 3) << 2
        return value

    def write(self, offset: int, value: int) -> None:
        forgets = offset == self.CSR and value & 1 << 24
        self.words[offset] = value & 0x00FFFFFF if forgets else value


class FlashController:
    """Unlocked by its keys; erases one sector to ones, programs by turning ones into zeros, and refuses all else."""

    ACR, KEYR, SR, CR = 0x00, 0x04, 0x0C, 0x10
    KEYS = (0x45670123, 0xCDEF89AB)
    PROGRAM, ERASE, START, LOCK = 1 << 0, 1 << 1, 1 << 16, 1 << 31
    WORDS, SECTOR = 2 << 8, 0xF << 3
    REFUSED, ERRORS = 1 << 7 | 1 << 4, 0xF2

    def __init__(self, sector: int, content: bytearray, stall: Callable[[float], None]) -> None:
        self.sector, self.content, self.stall = sector, content, stall
        self.access = self.status = 0
        self.control = self.LOCK
        self.keys: list[int] = []
        self.broken = False

    def read(self, offset: int) -> int:
        return {self.ACR: self.access, self.SR: self.status, self.CR: self.control}.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        if offset == self.ACR:
            self.access = value
        elif offset == self.KEYR:
            self.keys.append(value)
            if tuple(self.keys[-2:]) == self.KEYS:
                self.control &= ~self.LOCK
        elif offset == self.SR:
            self.status &= ~(value & self.ERRORS)
        elif offset == self.CR and not self.control & self.LOCK:
            self._order(value)

    def _order(self, value: int) -> None:
        self.control = value & ~self.START
        if not value & self.START:
            return
        if value & self.ERASE and (value & self.SECTOR) >> 3 == self.sector:
            self.content[:] = b"\xff" * SECTOR_BYTES
            self.stall(ERASE_S)
        else:
            self.status |= self.REFUSED

    def program(self, offset: int, size: int, value: int) -> None:
        """A store to the sector's own addresses."""
        ready = self.control & (self.LOCK | self.PROGRAM | 3 << 8) == self.PROGRAM | self.WORDS
        if not ready or size != 4 or self.broken:
            self.status |= self.REFUSED
            return
        old = int.from_bytes(self.content[offset : offset + 4], "little")
        self.content[offset : offset + 4] = (old & value).to_bytes(4, "little")
        self.stall(WORD_S)
