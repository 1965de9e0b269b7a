"""Emulated clock and flash controllers of the F446."""

from __future__ import annotations

from collections.abc import Callable

SECTOR_BYTES = 16 * 1024
ERASE_S = 0.25  # typical for 16 KB; data sheet: at most 0.5 s
WORD_S = 16e-6


class Clock:
    """Clock controller: oscillators and PLL become ready after being enabled, unless they or their source are dead."""

    CR, PLLCFGR, CFGR, AHB1ENR, CSR = 0x00, 0x04, 0x08, 0x30, 0x74
    CRYSTAL_ON, CRYSTAL_READY, PLL_ON, PLL_READY = 1 << 16, 1 << 17, 1 << 24, 1 << 25
    FROM_CRYSTAL = 1 << 22
    WATCHDOG_RESET, POWER_RESET = 1 << 29, 1 << 27
    RC_HZ, CRYSTAL_HZ = 16e6, 8e6

    SLOW = 5  # reads of a register until an enabled part is ready

    def __init__(self, dead_crystal: bool = False, dead_pll: bool = False, watchdog: bool = False) -> None:
        self.dead_crystal, self.dead_pll = dead_crystal, dead_pll
        self.looks = 0
        self.words: dict[int, int] = {self.CSR: self.WATCHDOG_RESET if watchdog else self.POWER_RESET}

    def read(self, offset: int) -> int:
        value = self.words.get(offset, 0)
        self.looks += 1
        if self.looks % self.SLOW:
            return value
        if offset == self.CR:
            value |= self.CRYSTAL_READY if value & self.CRYSTAL_ON and not self.dead_crystal else 0
            value |= self.PLL_READY if value & self.PLL_ON and self._pll_is_fed else 0
        if offset == self.CFGR:
            value |= (value & 3) << 2
        return value

    def write(self, offset: int, value: int) -> None:
        forgets = offset == self.CSR and value & 1 << 24
        self.words[offset] = value & 0x00FFFFFF if forgets else value

    @property
    def backup_is_clocked(self) -> bool:
        """True if the clock of the backup RAM is enabled."""
        return bool(self.words.get(self.AHB1ENR, 0) >> 18 & 1)

    @property
    def _pll_is_fed(self) -> bool:
        from_crystal = bool(self.words.get(self.PLLCFGR, 0) & self.FROM_CRYSTAL)
        return not self.dead_pll and not (from_crystal and self.dead_crystal)

    @property
    def core_hz(self) -> float:
        """Frequency of core and AHB, in Hz."""
        if self.words.get(self.CFGR, 0) & 3 != 2:
            return self.RC_HZ
        word = self.words[self.PLLCFGR]
        source = self.CRYSTAL_HZ if word & self.FROM_CRYSTAL else self.RC_HZ
        return source / (word & 63) * (word >> 6 & 511) / (2 * (word >> 16 & 3) + 2)

    @property
    def apb1_hz(self) -> float:
        """Frequency of the slow peripheral bus, in Hz; its timers run at twice that unless it is undivided."""
        return self.core_hz / self._divider(10)

    def _divider(self, shift: int) -> int:
        code = self.words.get(self.CFGR, 0) >> shift & 7
        return 1 if code < 4 else 2 << (code - 4)


class FlashController:
    """Flash controller: unlocked by keys, it erases one sector, programs ones to zeros, and rejects the rest."""

    ACR, KEYR, SR, CR = 0x00, 0x04, 0x0C, 0x10
    KEYS = (0x45670123, 0xCDEF89AB)
    PROGRAM, ERASE, START, LOCK = 1 << 0, 1 << 1, 1 << 16, 1 << 31
    WORDS, SECTOR = 2 << 8, 0xF << 3
    REFUSED, ERRORS, BUSY = 1 << 7 | 1 << 4, 0xF2, 1 << 16
    LOOKS = 2  # reads of the status until it is no longer busy

    def __init__(self, sector: int, content: bytearray, stall: Callable[[float], None]) -> None:
        self.sector, self.content, self.stall = sector, content, stall
        self.access = self.status = 0
        self.control = self.LOCK
        self.keys: list[int] = []
        self.busy = 0
        self.slow_looks = 0
        self.broken = False

    def read(self, offset: int) -> int:
        if offset == self.SR and self.busy:
            self.busy -= 1
            return self.BUSY
        if offset == self.ACR and self.slow_looks:
            self.slow_looks -= 1
            return 0
        return {self.ACR: self.access, self.SR: self.status, self.CR: self.control}.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        if offset == self.ACR:
            self.slow_looks = (
                self.LOOKS if value & 0xF != self.access & 0xF else 0
            )  # wait states take effect with a delay
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
            self.busy = self.LOOKS
            self.stall(ERASE_S)
        else:
            self.status |= self.REFUSED

    def program(self, offset: int, size: int, value: int) -> None:
        """Program a word of the sector."""
        ready = self.control & (self.LOCK | self.PROGRAM | 3 << 8) == self.PROGRAM | self.WORDS
        if not ready or size != 4 or self.broken:
            self.status |= self.REFUSED
            return
        old = int.from_bytes(self.content[offset : offset + 4], "little")
        self.content[offset : offset + 4] = (old & value).to_bytes(4, "little")
        self.busy = self.LOOKS
        self.stall(WORD_S)
