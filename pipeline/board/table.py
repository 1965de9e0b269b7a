"""What a mode table holds, and what its values may be.

All amplitudes are fractions of full scale at the converter's pins (1 = the largest swing about mid-scale), so that a
gain is a plain ratio, sensor over drive.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass

from firmware import table_format as layout

FREQUENCY_LOW_HZ = 20.0
FREQUENCY_HIGH = 0.4  # of the sample rate
RATE_HZ = (1e3, 1e6)
TAU_S = (1e-6, 10.0)
DELAY_S = (0.0, 1e-3)
LIMIT = (1e-3, 1.0)
GAIN = (1e-6, 1e3)
WEIGHT_HIGH = 1.0
MATRIX_HIGH = 1e3


class TableError(ValueError):
    """A mode table that is damaged, of a refused version, or holds a value out of range; one line says which."""


@dataclass(frozen=True)
class Mode:
    """One resonance as the controller sees it: H = gain exp(-j w delay) / (1 + j tau (w - w0)), w0 = 2 pi frequency.

    frequency_hz in Hz; tau_s, the decay time of the amplitude, in s; gain None while nothing has computed or measured
    it; delay_s, the dead time from the DAC's update to the ADC's sample beyond the mode's own phase, in s; drive_limit
    and amplitude_limit as fractions of full scale; weights relative to the largest, one for each actuator and sensor.
    The two flags tell a measured tau or frequency from an assumed or computed one.
    """

    frequency_hz: float
    tau_s: float
    gain: complex | None = None
    delay_s: float = 0.0
    drive_limit: float = 1.0
    amplitude_limit: float = 0.8
    actuator_weights: tuple[complex, ...] = (1.0 + 0.0j,)
    sensor_weights: tuple[complex, ...] = (1.0 + 0.0j,)
    tau_identified: bool = False
    frequency_identified: bool = False

    @classmethod
    def from_quality(cls, frequency_hz: float, quality: float, **rest: object) -> Mode:
        """A mode whose time constant follows from an assumed quality factor: tau = Q / (pi f)."""
        return cls(frequency_hz, quality / (math.pi * frequency_hz), **rest)  # type: ignore[arg-type]

    @property
    def quality(self) -> float:
        """Quality factor Q = pi f tau."""
        return math.pi * self.frequency_hz * self.tau_s


@dataclass(frozen=True)
class Pattern:
    """A wanted motion of a six-channel plate: one complex sensor target per sensor, relative to the largest."""

    name: str
    targets: tuple[complex, ...]


@dataclass(frozen=True)
class Shape:
    """Shaping at one frequency: sensors = matrix @ drives, row by row, and the patterns to be reached.

    frequency_hz in Hz; tau_s, the plate's slowest decay time, in s; matrix (sensors, actuators) as full scale over full
    scale, None while it has not been identified.
    """

    frequency_hz: float
    tau_s: float
    patterns: tuple[Pattern, ...]
    matrix: tuple[tuple[complex, ...], ...] | None = None
    drive_limit: float = 1.0


@dataclass(frozen=True)
class ModeTable:
    """Everything the firmware reads: modes, shaping, and where they come from.

    sample_rate_hz in Hz; design_hash, 16 bytes that name the design and code which made the table; wanted, the index of
    the mode to be controlled; senses_displacement tells a strain-like sensor from a velocity-like one.
    """

    sample_rate_hz: float
    design_hash: bytes
    modes: tuple[Mode, ...]
    wanted: int = 0
    shapes: tuple[Shape, ...] = ()
    senses_displacement: bool = True
    version: int = layout.VERSION


def check(table: ModeTable) -> None:
    """Raises TableError for the first value out of range, naming where it stands and what is allowed."""
    if table.version != layout.VERSION:
        raise TableError(f"mode table: version {table.version} is refused, this program reads {layout.VERSION}")
    _check_counts(table)
    _within("table", "sample_rate_hz", table.sample_rate_hz, *RATE_HZ)
    for index, mode in enumerate(table.modes):
        _check_mode(f"mode {index}", mode, table.sample_rate_hz)
    for index, shape in enumerate(table.shapes):
        _check_shape(f"shape {index}", shape, table.sample_rate_hz)


def _check_counts(table: ModeTable) -> None:
    if len(table.design_hash) != 16:
        raise TableError(f"table: design_hash has {len(table.design_hash)} bytes, allowed 16")
    if not 0 <= len(table.modes) <= layout.MAX_MODES or not 0 <= len(table.shapes) <= layout.MAX_SHAPES:
        raise TableError(
            f"table: {len(table.modes)} modes and {len(table.shapes)} shapes, "
            f"allowed at most {layout.MAX_MODES} and {layout.MAX_SHAPES}"
        )
    if not table.modes and not table.shapes:
        raise TableError("table: holds neither a mode nor a shape")
    if not 0 <= table.wanted < max(len(table.modes), 1):
        raise TableError(f"table: wanted is {table.wanted}, allowed 0 to {max(len(table.modes), 1) - 1}")
    counts = set(_all_channel_counts(table))
    if len(counts) != 1:
        raise TableError(f"table: (actuators, sensors) differ from entry to entry: {sorted(counts)}")
    if not all(1 <= count <= layout.CHANNELS for count in next(iter(counts))):
        raise TableError(f"table: (actuators, sensors) is {counts.pop()}, allowed 1 to {layout.CHANNELS} each")


def _check_mode(where: str, mode: Mode, rate_hz: float) -> None:
    _within(where, "frequency_hz", mode.frequency_hz, FREQUENCY_LOW_HZ, FREQUENCY_HIGH * rate_hz)
    _within(where, "tau_s", mode.tau_s, *TAU_S)
    _within(where, "delay_s", mode.delay_s, *DELAY_S)
    _within(where, "drive_limit", mode.drive_limit, *LIMIT)
    _within(where, "amplitude_limit", mode.amplitude_limit, *LIMIT)
    if mode.gain is not None:
        largest = max(abs(mode.gain.real), abs(mode.gain.imag)) if _finite(mode.gain) else math.nan
        _within(where, "gain (larger of its parts)", largest, *GAIN)
    _parts_within(where, "actuator_weights", mode.actuator_weights, WEIGHT_HIGH)
    _parts_within(where, "sensor_weights", mode.sensor_weights, WEIGHT_HIGH)


def _check_shape(where: str, shape: Shape, rate_hz: float) -> None:
    _within(where, "frequency_hz", shape.frequency_hz, FREQUENCY_LOW_HZ, FREQUENCY_HIGH * rate_hz)
    _within(where, "tau_s", shape.tau_s, *TAU_S)
    _within(where, "drive_limit", shape.drive_limit, *LIMIT)
    if not 1 <= len(shape.patterns) <= layout.PATTERNS:
        raise TableError(f"{where}: {len(shape.patterns)} patterns, allowed 1 to {layout.PATTERNS}")
    for pattern in shape.patterns:
        if not (pattern.name.isascii() and pattern.name.isprintable() and 1 <= len(pattern.name) <= 8):
            raise TableError(f"{where}: pattern name {pattern.name!r}, allowed 1 to 8 printable ASCII characters")
        _parts_within(where, f"pattern {pattern.name}", pattern.targets, WEIGHT_HIGH)
    for row in shape.matrix or ():
        _parts_within(where, "matrix", row, MATRIX_HIGH)
        if len(row) != len(shape.matrix[0] if shape.matrix else row):
            raise TableError(f"{where}: matrix rows differ in length")


def _finite(value: complex) -> bool:
    return math.isfinite(value.real) and math.isfinite(value.imag)


def _within(where: str, name: str, value: float, low: float, high: float) -> None:
    low32, high32 = _as_float32(low), _as_float32(high)
    if not low32 <= _as_float32(value) <= high32:
        raise TableError(f"{where}: {name} is {value:g}, allowed {low:g} to {high:g}")


def _parts_within(where: str, name: str, values: tuple[complex, ...], high: float) -> None:
    for value in values:
        if not (_finite(value) and max(abs(value.real), abs(value.imag)) <= high):
            raise TableError(f"{where}: {name} holds {value}, allowed parts of at most {high:g}")


def _as_float32(value: float) -> float:
    try:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        return math.copysign(math.inf, value)


def _all_channel_counts(table: ModeTable) -> Iterator[tuple[int, int]]:
    for mode in table.modes:
        yield len(mode.actuator_weights), len(mode.sensor_weights)
    for shape in table.shapes:
        sensors = len(shape.patterns[0].targets) if shape.patterns else 0
        for pattern in shape.patterns:
            yield sensors, len(pattern.targets)
        if shape.matrix is not None:
            yield len(shape.matrix[0]) if shape.matrix else 0, len(shape.matrix)


def channel_counts(table: ModeTable) -> tuple[int, int]:
    return next(_all_channel_counts(table))
