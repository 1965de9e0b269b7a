"""Emulated STM32F446 that runs the unmodified image; each build adds what is connected to its converters.

Unicorn executes the Cortex-M4 code, including start-up. It does not raise interrupts, so the board calls the handlers
as the hardware would: the fast one at every sample, PendSV when the image requests it, and SysTick at the rate of its
reload value. After each of them the main loop runs until it waits again; its passes take no time. Peripherals are
memory shared with the emulator, except that clock and flash controllers respond through callbacks. Baud rate and
SysTick rate follow from the clock set up by the image. Every execution ends at a wait for interrupt, because with an
end address Unicorn would translate the code again each time.
"""

from __future__ import annotations

import copy
import ctypes
import math
import mmap
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from unicorn import UC_ARCH_ARM, UC_MODE_MCLASS, UC_MODE_THUMB, UC_PROT_ALL, Uc
from unicorn.arm_const import (
    UC_ARM_REG_FPEXC,
    UC_ARM_REG_LR,
    UC_ARM_REG_PC,
    UC_ARM_REG_R0,
    UC_ARM_REG_R1,
    UC_ARM_REG_R2,
    UC_ARM_REG_S0,
    UC_ARM_REG_S1,
    UC_ARM_REG_SP,
    UC_CPU_ARM_CORTEX_M4,
)

from firmware.build import FLASH_START, RAM_START, TABLE_START
from firmware.host import Supervised
from firmware.image import Elf
from firmware.protocol import BAUD

SECTOR_BYTES = 16 * 1024
ERASE_S = 0.25  # typical for 16 KB; data sheet: at most 0.5 s
WORD_S = 16e-6

RAM, STUBS, FLASH = RAM_START, 0x00100000, FLASH_START
APB1, APB2, AHB1, DMA = 0x40000000, 0x40010000, 0x40020000, 0x40026000
CORE, DEBUG = 0xE0000000, 0xE0042000
RAM_BYTES = 128 * 1024

# Shared memory by its start address. RAM comes first: if it is mapped after the code, a store to it discards
# translations of code at the same offset. Flash memory: sectors 0 to 2.
SHARED = {RAM: RAM_BYTES, STUBS: 0x1000, FLASH: 48 * 1024, APB1: 0x8000, APB2: 0x4000, AHB1: 0x3000}

SHARED |= {DMA: 0x1000, CORE: 0x10000, DEBUG: 0x1000}
SECTOR, SECTOR_NUMBER = TABLE_START, 3
CONTROL, CONTROL_BYTES = 0x40023000, 0x1000
CLOCK_CONTROL, FLASH_CONTROL = 0x800, 0xC00  # offsets within CONTROL
BACKUP, BACKUP_BYTES = 0x40024000, 4096
RETURN = STUBS + 0x80
IWDG = 0x40003000
PWR_CR, PWR_CSR, GPIOC_IDR, ICSR = 0x40007000, 0x40007004, 0x40020810, 0xE000ED04
RECEIVE, SEND = DMA + 0x10 + 0x18 * 5, DMA + 0x10 + 0x18 * 6  # DMA1 streams: CR, NDTR, PAR, M0AR
SYSTICK_CONTROL, SYSTICK_RELOAD = 0xE000E010, 0xE000E014
NVIC_ENABLE = 0xE000E100
USART_BRR = 0x40004408
OVERDRIVE_READY = 3 << 16  # enabled and selected
WAIT_FOR_INTERRUPT = b"\x30\xbf"
BOOT_INSTRUCTIONS = 20_000_000
BAUD_TOLERANCE = 0.03  # tolerance of ten bits
TIME_ERROR_S = 1e-9  # round-off in sums of periods
LSI_HZ = 32e3  # data sheet: 17 to 47 kHz

# Stub that enters a handler as the core does (saves registers, chains PendSV if requested) and resumes the main loop.
ENTRY = bytes.fromhex(
    "2de90f50 2ded100a f1ee100a 11b4 dff834c0 e047 0c48 0168 c900 08d5 0021 0160 0a48 0168 0131 0160 dff824c0 e047"
    "11bc e1ee100a bdec100a bde80f50 dff814f0 00bf 00bf"
)

HANDLER, PENDING, WINDOWS, SLOW, BACK = 0x44, 0x48, 0x4C, 0x50, 0x54  # words after the stub
NOTHING, WINDOWS_COUNT = 0x58, 0x60  # bx lr; slow steps so far

_CHANGING = (
    "time_s",
    "fed_s",
    "sent_s",
    "delivered_s",
    "ticked_s",
    "seen_windows",
    "bitten",
    "hung",
    "fast_lost",
    "resets",
)

_WHOLE = (UC_ARM_REG_R0, UC_ARM_REG_R1, UC_ARM_REG_R2)
_FRACTIONS = (UC_ARM_REG_S0, UC_ARM_REG_S1)


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


@dataclass(frozen=True)
class Chip:
    """Deviations from an intact F446: dead clocks, response of the overdrive, watchdog clock, missing backup memory."""

    dead_crystal: bool = False
    dead_pll: bool = False
    overdrive: int = OVERDRIVE_READY
    lsi_hz: float = LSI_HZ
    has_backup: bool = True


class EmulatedBoard(Supervised):
    """Image and peripherals in lock step; run(seconds) advances the time, and builds define the effect of a trigger."""

    FAST_HANDLER = "ADC_IRQHandler"
    BUILD = "an_single_build"
    WORLD: tuple[str, ...] = ()  # attributes of a build that change with time

    def __init__(self, image: Path, sample_rate_hz: float, chip: Chip) -> None:
        self.elf, self.chip = Elf.read(image), chip
        self.sample_s = 1.0 / sample_rate_hz
        self.resets = 0
        self.time_s = 0.0
        self.on_window: Callable[[], None] | None = None
        self.app: Any = None  # state of the application, set by the build
        self.uc = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
        self.uc.ctl_set_cpu_model(UC_CPU_ARM_CORTEX_M4)
        self.words: dict[int, ctypes.c_uint32] = {}
        self.memory = {start: self._shared(start, size) for start, size in SHARED.items()}
        self.watchdog = [self.word(IWDG + at) for at in (0, 4, 8)]
        self.systick, self.sending = self.word(SYSTICK_CONTROL), self.word(SEND)
        self.uc.mmio_map(CONTROL, CONTROL_BYTES, self._control_read, None, self._control_write, None)
        self.sector = bytearray(b"\xff" * SECTOR_BYTES)
        self.uc.mmio_map(SECTOR, SECTOR_BYTES, self._read_from(self.sector), None, self._sector_write, None)
        self.backup = bytearray(BACKUP_BYTES if chip.has_backup else 0)
        self.uc.mmio_map(BACKUP, BACKUP_BYTES, self._read_from(self.backup), None, self._backup_write, None)
        self._load()
        self._write_stubs()
        self.reset()

    def reset(self, by_watchdog: bool = False) -> None:
        """Reset by the reset line or the watchdog: clear the peripherals, keep the memory, restart the image."""
        for start in (APB1, APB2, AHB1, DMA, CORE):
            ctypes.memset(self._address(start), 0, SHARED[start])
        self.clock = Clock(self.chip.dead_crystal, self.chip.dead_pll, by_watchdog)
        self.flash = FlashController(SECTOR_NUMBER, self.sector, self._stall)
        self.bitten = self.hung = self.fast_lost = False
        self.word(PWR_CSR).value = self.chip.overdrive
        self.press(False)
        self.fed_s = self.sent_s = self.delivered_s = self.ticked_s = self.time_s
        self.received = bytearray()
        self.incoming = bytearray()
        self.main_stuck = False
        self.uc.reg_write(UC_ARM_REG_FPEXC, 0x40000000)
        self.uc.reg_write(UC_ARM_REG_SP, int.from_bytes(self._flash_bytes(0, 4), "little"))
        self.uc.emu_start(self.symbol("Reset_Handler") | 1, 0, count=BOOT_INSTRUCTIONS)
        if self.uc.reg_read(UC_ARM_REG_PC) & ~1 != self.idle + len(WAIT_FOR_INTERRUPT):
            raise RuntimeError("the image never reached its main loop")
        self.ring_bytes = self.word(RECEIVE + 4).value
        systick = self.systick.value & 3 == 3
        self.systick_s = (self.word(SYSTICK_RELOAD).value + 1) / self.clock.core_hz if systick else math.inf
        self.seen_windows = self.windows.value

    def run(self, seconds: float) -> None:
        """Advance by a time."""
        for _ in range(round(seconds / self.sample_s)):
            self.tick()

    def run_until(self, condition: Callable[[], bool], seconds: float) -> bool:
        """Advance until a condition, checked every 50 ticks, holds; return False if the time is over first."""
        end = self.time_s + seconds
        while self.time_s < end:
            for _ in range(50):
                self.tick()
            if condition():
                return True
        return False

    def tick(self) -> None:
        """Advance by one sample: converters at the trigger, then the interrupts, each followed by the main loop."""
        if self._exchange() and not self.hung and not self.fast_lost:
            self.interrupt(self.fast_handler)
        self.time_s += self.sample_s
        self._serve_systick()
        self._serve_uart()
        self._serve_watchdog()
        if self.windows.value != self.seen_windows:
            self.seen_windows = self.windows.value
            if self.on_window:
                self.on_window()

    def interrupt(self, handler: int) -> None:
        """Run a handler, then PendSV if requested, then the main loop until it waits again."""
        self.handler.value = handler | 1
        self.uc.emu_start(STUBS | 1, 0)

    def interrupt_unexpectedly(self) -> None:
        """Raise an unexpected exception, such as a clock failure, on the main loop's stack; it never returns."""
        stack = self.uc.reg_read(UC_ARM_REG_SP) - 32
        frame = struct.pack("<8I", *range(5), self.uc.reg_read(UC_ARM_REG_LR), self.idle, 1 << 24)
        self.poke(stack, frame)
        self.uc.reg_write(UC_ARM_REG_SP, stack)
        self.uc.emu_start(self.symbol("Unexpected_Handler") | 1, 0, count=300)
        self.main_stuck = True
        self.hung = True

    @property
    def slow_stuck(self) -> bool:
        """True to keep PendSV from running, as if a handler of higher priority never ended."""
        return self.slow.value == STUBS + NOTHING | 1

    @slow_stuck.setter
    def slow_stuck(self, stuck: bool) -> None:
        self.slow.value = (STUBS + NOTHING if stuck else self.symbol("PendSV_Handler")) | 1

    @property
    def main_stuck(self) -> bool:
        """True to keep the main loop from running, as if it were busy for ever."""
        return self.back.value == self.idle | 1

    @main_stuck.setter
    def main_stuck(self, stuck: bool) -> None:
        self.back.value = (self.idle if stuck else self.idle + len(WAIT_FOR_INTERRUPT)) | 1

    def is_enabled(self, line: int) -> bool:
        """True if the image has enabled an interrupt."""
        return bool(self.word(NVIC_ENABLE + 4 * (line // 32)).value >> (line % 32) & 1)

    def _exchange(self) -> bool:
        """Exchange samples with the plate at a trigger; return True if the fast handler follows."""
        raise NotImplementedError

    def send(self, data: bytes) -> None:
        """Send bytes from the host, which arrive at the baud rate."""
        self.incoming += data

    def press(self, pressed: bool) -> None:
        """Press or release the blue button."""
        self.word(GPIOC_IDR).value = 0 if pressed else 1 << 13

    def word(self, address: int) -> ctypes.c_uint32:
        """Return a 32-bit word of shared memory, to be read and written in place."""
        if address not in self.words:
            self.words[address] = ctypes.c_uint32.from_address(self._address(address))
        return self.words[address]

    def symbol(self, name: str) -> int:
        """Return the address of an object or function of the image."""
        return self.elf.symbols[name].address

    def poke(self, address: int, data: bytes) -> None:
        """Overwrite bytes of shared memory."""
        ctypes.memmove(self._address(address), data, len(data))

    def pointer(self, name: str) -> int:
        """Return the address in this process of an object in the image's RAM."""
        return self._address(self.symbol(name))

    def call(self, name: str, *arguments: int | float) -> int:
        """Call a function of the image from its main loop, with integers from r0 and floats from s0; return r0."""
        context = self.uc.context_save()
        whole = [value for value in arguments if isinstance(value, int)]
        fractions = [struct.pack("<f", value) for value in arguments if isinstance(value, float)]
        for register, value in zip(_WHOLE, whole, strict=False):
            self.uc.reg_write(register, value)
        for register, packed in zip(_FRACTIONS, fractions, strict=False):
            self.uc.reg_write(register, int.from_bytes(packed, "little"))
        self.uc.reg_write(UC_ARM_REG_LR, RETURN | 1)
        self.uc.emu_start(self.symbol(name) | 1, 0)
        result = self.uc.reg_read(UC_ARM_REG_R0)
        self.uc.context_restore(context)
        return int(result)

    @property
    def at_rest(self) -> bool:
        """True while all outputs are at rest."""
        raise NotImplementedError

    @contextmanager
    def undone(self) -> Iterator[None]:
        """Restore image, peripherals and plate at the end of the context."""
        context, memory = self.uc.context_save(), {start: bytes(block) for start, block in self.memory.items()}
        kept = {name: copy.deepcopy(vars(self)[name]) for name in (*self.WORLD, *_CHANGING)}
        own = {name: value for name, value in vars(self).items() if name == "sense"}
        yield
        for start, block in memory.items():
            self.memory[start][:] = block
        self.uc.context_restore(context)
        vars(self).pop("sense", None)
        vars(self).update(kept | own)

    def clear(self) -> bool:
        """Leave the fault state, as the button or a host would; return False if that is not allowed."""
        return bool(self.call("an_application_clear", self.symbol("app"), self.symbol(self.BUILD)) & 0xFF)

    def _shared(self, start: int, size: int) -> mmap.mmap:
        memory = mmap.mmap(-1, size)
        address = ctypes.addressof(ctypes.c_char.from_buffer(memory))
        self.uc.mem_map_ptr(start, size, UC_PROT_ALL, address)
        return memory

    def _address(self, address: int) -> int:
        for start, size in SHARED.items():
            if start <= address < start + size:
                return ctypes.addressof(ctypes.c_char.from_buffer(self.memory[start])) + address - start
        raise ValueError(f"no shared memory at {address:#x}")

    def _flash_bytes(self, offset: int, length: int) -> bytes:
        return self.memory[FLASH][offset : offset + length]

    def _load(self) -> None:
        for segment in self.elf.segments:
            home, start = (self.sector, SECTOR) if segment.load_address >= SECTOR else (self.memory[FLASH], FLASH)
            at = segment.load_address - start
            home[at : at + len(segment.data)] = segment.data
        main = self.elf.symbols["main"]
        at = self._flash_bytes(main.address - FLASH, main.size).index(WAIT_FOR_INTERRUPT)
        self.idle = main.address + at

    def _write_stubs(self) -> None:
        self.fast_handler = self.symbol(self.FAST_HANDLER)
        self.poke(STUBS, ENTRY)
        self.poke(STUBS + NOTHING, b"\x70\x47")
        self.poke(RETURN, WAIT_FOR_INTERRUPT)
        places = (HANDLER, WINDOWS, SLOW, BACK)
        self.handler, count, self.slow, self.back = (self.word(STUBS + at) for at in places)
        self.word(STUBS + PENDING).value = ICSR
        self.windows = self.word(STUBS + WINDOWS_COUNT)
        count.value = STUBS + WINDOWS_COUNT
        self.slow_stuck = self.main_stuck = False

    def _serve_systick(self) -> None:
        while self.time_s - self.ticked_s >= self.systick_s - TIME_ERROR_S and not self.hung:
            self.ticked_s += self.systick_s
            if self.systick.value & 3 == 3:
                self.interrupt(self.symbol("SysTick_Handler"))

    def _serve_watchdog(self) -> None:
        self._watch()
        if self.bitten:
            self.resets += 1
            self.reset(by_watchdog=True)

    def _watch(self) -> None:
        """Check whether the watchdog has been fed in time."""
        key, prescaler, reload = self.watchdog
        if key.value == 0xAAAA:
            key.value = 0
            self.fed_s = self.time_s
        self.bitten |= self.time_s - self.fed_s > (reload.value + 1) * (4 << prescaler.value) / self.chip.lsi_hz

    def _stall(self, seconds: float) -> None:
        """Let time pass while the busy flash memory stalls the chip."""
        self._watch()
        self.time_s += seconds
        self.ticked_s += seconds
        self._watch()

    @property
    def byte_s(self) -> float:
        """Duration of a byte (ten bits) on the line, from the divider and clock set by the image, in s."""
        return 10.0 * self.word(USART_BRR).value / self.clock.apb1_hz

    def _on_the_line(self, data: bytes) -> bytes:
        """Return the bytes as received at the other end: garbled if the two baud rates differ too much."""
        off = abs(10.0 / self.byte_s / BAUD - 1.0)
        return data if off <= BAUD_TOLERANCE else bytes(byte * 7 + 3 & 0xFF for byte in data)

    def _serve_uart(self) -> None:
        control = self.sending
        sending = control.value & 1
        if not sending and not self.incoming:
            self.sent_s = self.delivered_s = self.time_s
            return
        count = int((self.time_s - self.delivered_s) / self.byte_s)
        self._deliver(count)
        self.delivered_s += count * self.byte_s
        length, memory = self.word(SEND + 4), self.word(SEND + 12)
        if sending and self.time_s >= self.sent_s + length.value * self.byte_s:
            self.received += self._on_the_line(ctypes.string_at(self._address(memory.value), length.value))
            control.value &= ~1
            self.sent_s = self.time_s

    def _deliver(self, count: int) -> None:
        """Write the bytes received meanwhile to the ring buffer of the receiving DMA stream."""
        control, left, memory = self.word(RECEIVE), self.word(RECEIVE + 4), self.word(RECEIVE + 12)
        if not control.value & 1 or not self.incoming:
            return
        start = self._address(memory.value)
        for byte in self._on_the_line(bytes(self.incoming[:count])):
            ctypes.c_uint8.from_address(start + self.ring_bytes - left.value).value = byte
            left.value = left.value - 1 or self.ring_bytes
        del self.incoming[:count]

    def _control_read(self, _: Uc, offset: int, size: int, __: Any) -> int:
        part, start = self._controller(offset)
        return part.read(offset - start)

    def _control_write(self, _: Uc, offset: int, size: int, value: int, __: Any) -> None:
        part, start = self._controller(offset)
        part.write(offset - start, value)

    def _controller(self, offset: int) -> tuple[Clock | FlashController, int]:
        return (self.flash, FLASH_CONTROL) if offset >= FLASH_CONTROL else (self.clock, CLOCK_CONTROL)

    def _read_from(self, memory: bytearray) -> Callable[[Uc, int, int, Any], int]:
        return lambda _, offset, size, __: int.from_bytes(memory[offset : offset + size], "little")

    def _backup_write(self, _: Uc, offset: int, size: int, value: int, __: Any) -> None:
        """Write to the backup memory if its domain is unlocked and clocked."""
        if self.backup and self.word(PWR_CR).value >> 8 & 1 and self.clock.backup_is_clocked:
            self.backup[offset : offset + size] = value.to_bytes(size, "little")

    def _sector_write(self, _: Uc, offset: int, size: int, value: int, __: Any) -> None:
        self.flash.program(offset, size, value)
