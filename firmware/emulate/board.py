"""An emulated STM32F446 that runs the unmodified image; what stands at its converters is for the builds to say.

Unicorn executes the Cortex-M4 code, start-up included. It raises no interrupts by itself, so this board calls the handlers as
the hardware would: the fast one at every sample, PendSV when the image asked for it, and the main loop goes on when a
slow step woke it. Peripherals are memory that both sides see; clock and flash controller answer through callbacks.
"""

from __future__ import annotations

import ctypes
import mmap
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

from unicorn import UC_ARCH_ARM, UC_HOOK_CODE, UC_MODE_MCLASS, UC_MODE_THUMB, UC_PROT_ALL, Uc, UcError
from unicorn.arm_const import (
    UC_ARM_REG_FPEXC,
    UC_ARM_REG_LR,
    UC_ARM_REG_R0,
    UC_ARM_REG_R1,
    UC_ARM_REG_R2,
    UC_ARM_REG_S0,
    UC_ARM_REG_S1,
    UC_ARM_REG_SP,
    UC_CPU_ARM_CORTEX_M4,
)

from firmware.elf import Elf
from firmware.emulate.controllers import SECTOR_BYTES, Clock, FlashController

FLASH, FLASH_BYTES = 0x08000000, 48 * 1024  # sectors 0 to 2
SECTOR, SECTOR_NUMBER = 0x0800C000, 3
RAM, RAM_BYTES = 0x20000000, 128 * 1024
APB1, APB1_BYTES = 0x40000000, 0x8000
APB2, APB2_BYTES = 0x40010000, 0x4000
AHB1, AHB1_BYTES = 0x40020000, 0x3000
CONTROL, CONTROL_BYTES = 0x40023000, 0x1000
CLOCK_CONTROL, FLASH_CONTROL = 0x800, 0xC00  # within it
DMA, DMA_BYTES = 0x40026000, 0x1000
CORE, CORE_BYTES = 0xE0000000, 0x10000
STUBS = 0x00100000
RETURN = STUBS + 0x20

IWDG = 0x40003000
PWR_CSR, GPIOC_IDR, ICSR = 0x40007004, 0x40020810, 0xE000ED04
RECEIVE, SEND = DMA + 0x10 + 0x18 * 5, DMA + 0x10 + 0x18 * 6  # DMA1 streams: CR, NDTR, PAR, M0AR
PENDSV, WAIT_FOR_INTERRUPT = 1 << 28, b"\x30\xbf"
BOOT_INSTRUCTIONS = 20_000_000
BYTE_S = 10 * 49 / 45e6  # ten bits, 45 MHz / 49


class EmulatedBoard:
    """The image and its peripherals in lock step; time moves by run(seconds). Builds say what a trigger does (_exchange)."""

    FAST_HANDLER = "ADC_IRQHandler"

    def __init__(self, image: Path, sample_rate_hz: float, dead_crystal: bool = False) -> None:
        self.elf = Elf.read(image)
        self.sample_s = 1.0 / sample_rate_hz
        self.dead_crystal = dead_crystal
        self.resets = 0
        self.on_window: Callable[[], None] | None = None
        self.slow_stuck = False
        self.uc = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
        self.uc.ctl_set_cpu_model(UC_CPU_ARM_CORTEX_M4)
        self.memory = {start: self._shared(start, size) for start, size in _SHARED}
        self.uc.mmio_map(CONTROL, CONTROL_BYTES, self._control_read, None, self._control_write, None)
        self.sector = bytearray(b"\xff" * SECTOR_BYTES)
        self.uc.mmio_map(SECTOR, SECTOR_BYTES, self._sector_read, None, self._sector_write, None)
        self._load()
        self._write_stubs()
        self.reset()

    def reset(self, by_watchdog: bool = False) -> None:
        """As the reset line, or the watchdog, does: peripherals clear, memory stays, the image starts anew."""
        for start in (APB1, APB2, AHB1, DMA, CORE):
            ctypes.memset(self._address(start), 0, dict(_SHARED)[start])
        self.clock = Clock(self.dead_crystal, by_watchdog)
        self.flash = FlashController(SECTOR_NUMBER, self.sector, self._stall)
        self.bitten = False
        self.word(PWR_CSR).value = 3 << 16
        self.press(False)
        self.time_s = 0.0
        self.fed_s = 0.0
        self.sent_s = 0.0
        self.delivered_s = 0.0
        self.received = bytearray()
        self.incoming = bytearray()
        self.uc.reg_write(UC_ARM_REG_FPEXC, 0x40000000)
        self.uc.reg_write(UC_ARM_REG_SP, int.from_bytes(self._flash_bytes(0, 4), "little"))
        self._run(self.elf.symbols["Reset_Handler"].address, self.idle, BOOT_INSTRUCTIONS)
        self.main_context = self.uc.context_save()
        self.ring_bytes = self.word(RECEIVE + 4).value

    def run(self, seconds: float) -> None:
        """Advances by a time."""
        for _ in range(round(seconds / self.sample_s)):
            self.tick()

    def run_until(self, condition: Callable[[], bool], seconds: float) -> bool:
        """Advances until a condition, looked at after each window, holds; False when it did not within the time."""
        end = self.time_s + seconds
        while self.time_s < end:
            for _ in range(50):
                self.tick()
            if condition():
                return True
        return False

    def tick(self) -> None:
        """One sample period: the converters at the trigger, then the interrupts, then the main loop if it was woken."""
        self._exchange()
        self._call(self.fast_stub)
        self.time_s += self.sample_s
        if self.pending.value & PENDSV:
            self.pending.value = 0
            self._end_window()

    def _end_window(self) -> None:
        if not self.slow_stuck:
            self._call(self.slow_stub)
        self._main_pass()
        if self.on_window:
            self.on_window()

    def _exchange(self) -> None:
        raise NotImplementedError

    def send(self, data: bytes) -> None:
        """Bytes from the host, to arrive at the line's pace."""
        self.incoming += data

    def press(self, pressed: bool) -> None:
        """The blue button."""
        self.word(GPIOC_IDR).value = 0 if pressed else 1 << 13

    def word(self, address: int) -> ctypes.c_uint32:
        """A 32-bit word of shared memory, to be read and written in place."""
        return ctypes.c_uint32.from_address(self._address(address))

    def symbol(self, name: str) -> int:
        """Address of an object or function of the image."""
        return self.elf.symbols[name].address

    @property
    def stack_pointer(self) -> int:
        """Where the main loop's stack ends while it waits."""
        self.uc.context_restore(self.main_context)
        return self.uc.reg_read(UC_ARM_REG_SP)

    def peek(self, address: int, length: int) -> bytes:
        """Bytes of shared memory."""
        return ctypes.string_at(self._address(address), length)

    def poke(self, address: int, data: bytes) -> None:
        """Overwrites bytes of shared memory."""
        ctypes.memmove(self._address(address), data, len(data))

    def pointer(self, name: str) -> int:
        """Where this process sees an object that the image keeps in RAM."""
        return self._address(self.symbol(name))

    def call(self, name: str, *arguments: int | float) -> int:
        """Calls a function of the image as its main loop would: whole numbers in r0 on, fractions in s0 on; returns r0."""
        self.uc.context_restore(self.main_context)
        whole = [value for value in arguments if isinstance(value, int)]
        fractions = [struct.pack("<f", value) for value in arguments if isinstance(value, float)]
        for register, value in zip(_WHOLE, whole, strict=False):
            self.uc.reg_write(register, value)
        for register, packed in zip(_FRACTIONS, fractions, strict=False):
            self.uc.reg_write(register, int.from_bytes(packed, "little"))
        self.uc.reg_write(UC_ARM_REG_LR, RETURN | 1)
        self._run(self.symbol(name), RETURN)
        return self.uc.reg_read(UC_ARM_REG_R0)

    def count_instructions(self, function: Callable[[], Any], within: str) -> int:
        """How many instructions of the image a function makes it execute from a routine's entry to its return."""
        count, back, entry, outside = 0, 0, self.symbol(within), True

        def each(uc: Uc, address: int, *_: Any) -> None:
            nonlocal count, outside, back
            if address == entry:
                outside, back = False, uc.reg_read(UC_ARM_REG_LR) & ~1
            elif address == back:
                outside = True
            count += not outside

        self.uc.ctl_flush_tb()  # type: ignore[attr-defined]  # code translated before knows of no hook
        hook = self.uc.hook_add(UC_HOOK_CODE, each)
        try:
            function()
        finally:
            self.uc.hook_del(hook)
        return count

    def _shared(self, start: int, size: int) -> mmap.mmap:
        memory = mmap.mmap(-1, size)
        address = ctypes.addressof(ctypes.c_char.from_buffer(memory))
        self.uc.mem_map_ptr(start, size, UC_PROT_ALL, address)
        return memory

    def _address(self, address: int) -> int:
        for start, size in _SHARED:
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
        self.pending = self.word(ICSR)

    def _write_stubs(self) -> None:
        """ldr r12, [pc, #4]; blx r12; nop: a call that returns to a place of our own."""
        self.uc.mem_map(STUBS, 0x1000)
        self.fast_stub, self.slow_stub = STUBS, STUBS + 0x10
        for stub, handler in ((self.fast_stub, self.FAST_HANDLER), (self.slow_stub, "PendSV_Handler")):
            code = b"\xdf\xf8\x04\xc0" + b"\xe0\x47" + b"\x00\xbf"
            self.uc.mem_write(stub, code + (self.symbol(handler) | 1).to_bytes(4, "little"))

    def _call(self, stub: int) -> None:
        self.uc.emu_start(stub | 1, stub + 6)

    def _run(self, start: int, end: int, limit: int = 0) -> None:
        self.uc.emu_start(start | 1, end, count=limit)

    def _main_pass(self) -> None:
        self._serve_uart()
        self.uc.context_restore(self.main_context)
        self._run(self.idle + 2, self.idle)
        self.uc.context_update(self.main_context)
        self._serve_watchdog()

    def _serve_watchdog(self) -> None:
        self._watch()
        if self.bitten:
            self.resets += 1
            self.reset(by_watchdog=True)

    def _watch(self) -> None:
        """Fed since it was looked at last, or too late; its oscillator runs at its nominal 32 kHz."""
        key, prescaler, reload = (self.word(IWDG + at).value for at in (0, 4, 8))
        if key == 0xAAAA:
            self.word(IWDG).value = 0
            self.fed_s = self.time_s
        self.bitten |= self.time_s - self.fed_s > (reload + 1) * (4 << prescaler) / 32e3

    def _stall(self, seconds: float) -> None:
        """The chip does nothing else while its flash memory is busy."""
        self._watch()
        self.time_s += seconds
        self._watch()

    def _serve_uart(self) -> None:
        self._deliver(max(round((self.time_s - self.delivered_s) / BYTE_S), 0))
        self.delivered_s = self.time_s
        control, length, memory = self.word(SEND), self.word(SEND + 4), self.word(SEND + 12)
        if control.value & 1 and self.time_s >= self.sent_s + length.value * BYTE_S:
            self.received += ctypes.string_at(self._address(memory.value), length.value)
            control.value &= ~1
            self.sent_s = self.time_s
        elif not control.value & 1:
            self.sent_s = self.time_s

    def _deliver(self, count: int) -> None:
        """Bytes that arrived meanwhile, into the ring that the image gave to the receiving DMA stream."""
        control, left, memory = self.word(RECEIVE), self.word(RECEIVE + 4), self.word(RECEIVE + 12)
        if not control.value & 1 or not self.incoming:
            return
        start = self._address(memory.value)
        for byte in self.incoming[:count]:
            ctypes.c_uint8.from_address(start + self.ring_bytes - left.value).value = byte
            left.value = left.value - 1 or self.ring_bytes
        del self.incoming[:count]

    def _control_read(self, _: Uc, offset: int, size: int, __: Any) -> int:
        part, start = (self.flash, FLASH_CONTROL) if offset >= FLASH_CONTROL else (self.clock, CLOCK_CONTROL)
        return part.read(offset - start)

    def _control_write(self, _: Uc, offset: int, size: int, value: int, __: Any) -> None:
        part, start = (self.flash, FLASH_CONTROL) if offset >= FLASH_CONTROL else (self.clock, CLOCK_CONTROL)
        part.write(offset - start, value)

    def _sector_read(self, _: Uc, offset: int, size: int, __: Any) -> int:
        return int.from_bytes(self.sector[offset : offset + size], "little")

    def _sector_write(self, _: Uc, offset: int, size: int, value: int, __: Any) -> None:
        self.flash.program(offset, size, value)


_SHARED = (
    (FLASH, FLASH_BYTES),
    (RAM, RAM_BYTES),
    (APB1, APB1_BYTES),
    (APB2, APB2_BYTES),
    (AHB1, AHB1_BYTES),
    (DMA, DMA_BYTES),
    (CORE, CORE_BYTES),
)

_WHOLE = (UC_ARM_REG_R0, UC_ARM_REG_R1, UC_ARM_REG_R2)
_FRACTIONS = (UC_ARM_REG_S0, UC_ARM_REG_S1)

__all__ = ["EmulatedBoard", "UcError"]
