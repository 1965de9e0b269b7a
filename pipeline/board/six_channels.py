"""Mode tables for six channels, of shaped beams and of travelling waves, and their playback on the emulated board.

`python -m pipeline.board.six_channels FILE.bin` writes the table of the 150 mm beam of the shaping study.
Each pattern is relative to its largest target. "left", "middle" and "right" have signals of 1 on a third of the sensors and 0
elsewhere. "left max", ... have the signals of the largest contrast (choi2002), and "wave+" and "wave-" those of the largest
travelling-wave ratio towards +x and -x.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from functools import partial
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from firmware.emulate.plant import Structure
from firmware.mode_table import (
    CHANNELS,
    FREQUENCY_HIGH,
    MAX_SHAPES,
    MIN_SHAPE_HZ,
    ModeTable,
    Pattern,
    Shape,
    describe,
    hold,
    to_bytes,
)
from geometry.elements import ComplexArray, FloatArray
from pipeline.board import export
from pipeline.board.export import design_hash, write
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.answer_parts import PlayedPattern, PlayFault
from pipeline.models.travelling import Travelling
from pipeline.quantity import UM, figure
from solvers.errors import SolverError
from solvers.shaping.modal_table import operating_frequencies, scan
from solvers.shaping.travelling_wave import best_travelling_drive, inner_window
from solvers.shaping.voltages import REGIONS, best_contrast, region_points, region_target
from solvers.thesis.shaped_beam import ShapedBeam, Signal
from solvers.thesis.shaping_study import travel_window

SAMPLE_RATE_HZ = 40_000.0
LARGEST = 0.5  # largest |T| in full scales at any frequency: setting of the conditioners
BAND_HZ = (MIN_SHAPE_HZ, 4500.0)
SCANNED = 221

NOISE = 1e-3  # of full scale, at every sensor
PATTERN_TAUS = 12.0  # duration of each pattern, in decay times
MIN_S = 0.3


def full_scale(model: ShapedBeam, signal: Signal, frequencies_hz: tuple[float, ...]) -> float:
    """Full scales of a sensor per unit of its signal, times the voltage of a full drive, for |T| of at most LARGEST."""
    return LARGEST / max(float(np.abs(model.matrix(f, signal)).max()) for f in frequencies_hz)


def patterns(model: ShapedBeam, signal: Signal, frequency_hz: float) -> tuple[Pattern, ...]:
    """Compute the eight patterns at a frequency. Raises SolverError."""
    matrix, field, line = model.matrix(frequency_hz, signal), model.field(frequency_hz), model.line_m
    named_targets: list[tuple[str, ComplexArray]] = [(region, region_target(region, len(matrix))) for region in REGIONS]
    for region, name in zip(REGIONS, ("left max", "mid max", "rightmax"), strict=True):
        inside = region_points(region, model.places_m, line)
        named_targets.append((name, matrix @ best_contrast(field, inside)))
    k = 2.0 * pi / model.free_wavelength_m(frequency_hz)
    window = inner_window(line, *travel_window(model, frequency_hz))
    for name, sign in (("wave+", 1.0), ("wave-", -1.0)):
        named_targets.append((name, matrix @ best_travelling_drive(field[window], sign * line[window], k)[0]))
    relative = ((name, target / target[np.argmax(np.abs(target))]) for name, target in named_targets)
    return tuple(Pattern(name, tuple(target.tolist())) for name, target in relative)


def shaping_table(model: ShapedBeam, signal: Signal, frequencies_hz: tuple[float, ...] = ()) -> ModeTable:
    """Build the table of a beam with up to six pairs of actuator and sensor; the default frequencies condition T best.

    T includes the droop and the half sample of the hold. Metres are per volt of the first sensor, to whose displacement at full
    scale the other conditioners are set. Raises InputError for more frequencies than a table holds or one
    that the board rejects, and SolverError.
    """
    if len(frequencies_hz) > MAX_SHAPES:
        raise InputError(f"--frequency: given {len(frequencies_hz)} times, must be at most {MAX_SHAPES}")
    chosen = frequencies_hz or _best(model, signal)
    if min(chosen) < MIN_SHAPE_HZ:
        raise InputError(
            f"--frequency = {min(chosen):g} Hz: must be {MIN_SHAPE_HZ:g} Hz or more for the six-channel board"
        )
    scale = full_scale(model, signal, chosen)
    slowest_s = float((model.table.quality_factor / (pi * model.table.frequencies_hz)).max())
    matrices = [scale * model.matrix(f, signal) * hold(f, SAMPLE_RATE_HZ) for f in chosen]
    metres = 0.0 if model.calibration is None else abs(complex(model.calibration[0]))
    shapes = tuple(
        Shape(f, slowest_s, patterns(model, signal, f), tuple(map(tuple, matrix.tolist())), metres_per_volt=metres)
        for f, matrix in zip(chosen, matrices, strict=True)
    )
    return ModeTable(SAMPLE_RATE_HZ, design_hash([model.name, signal, list(chosen)]), shapes=shapes)


def plate_table(
    matrix: ComplexArray, frequency_hz: float, tau_s: float, drives: dict[str, ComplexArray], metres: float = 0.0
) -> ModeTable:
    """Build the table of a plate with up to six drivers and sensors from T (sensors, drivers) at one frequency.

    matrix: T in full scales, as sampled by the board; drives: voltages (drivers,) of each pattern by its name, whose sensor
    signals become the targets; metres: per volt of the sensors. Raises InputError for a frequency that the board cannot play.
    """
    highest = FREQUENCY_HIGH * SAMPLE_RATE_HZ
    if not MIN_SHAPE_HZ <= frequency_hz <= highest:
        raise InputError(f"{frequency_hz:g} Hz: must be {MIN_SHAPE_HZ:g} to {highest:g} Hz for the six-channel board")
    targets = {name: matrix @ volts for name, volts in drives.items()}
    named = tuple(Pattern(name, tuple((w / w[np.argmax(np.abs(w))]).tolist())) for name, w in targets.items())
    shape = Shape(frequency_hz, tau_s, named, tuple(map(tuple, matrix.tolist())), metres_per_volt=metres)
    return ModeTable(SAMPLE_RATE_HZ, design_hash([frequency_hz, repr(matrix.tolist())]), shapes=(shape,))


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    from pipeline.case.limits import parse_frequency
    from solvers.thesis.shaped_beam import patched, pointed
    from solvers.thesis.shaping_study import ShapingData

    parser = argparse.ArgumentParser(prog="python -m pipeline.board.six_channels", description=__doc__)
    parser.add_argument("file", type=Path, help="output FILE.bin; FILE.h in the same folder holds the same bytes")
    parser.add_argument(
        "--points", action="store_true", help="use the ideal beam of points instead of the real patches"
    )
    parser.add_argument(
        "--frequency", action="append", default=[], help=f"frequency with its unit (at most {MAX_SHAPES} times)"
    )
    parser.add_argument("--unmeasured", action="store_true", help="omit T: the board measures its own before it drives")
    chosen = parser.parse_args(arguments)
    data = ShapingData()
    try:
        tones = tuple(parse_frequency(text, "--frequency") for text in chosen.frequency)
        if chosen.points:
            table = shaping_table(pointed("150 mm, points", data.beam, data.modes), "displacement", tones)
        else:
            beam = patched("150 mm, patches", data.beam, data.modes, data.calibrate_near_hz)
            table = shaping_table(beam, "calibrated", tones)
        if chosen.unmeasured:
            table = replace(table, shapes=tuple(replace(shape, matrix=None) for shape in table.shapes))
        write(table, chosen.file.parent, chosen.file.stem)
    except (InputError, SolverError, ValueError, OSError) as error:
        print(f"mode table: {error}", file=sys.stderr)
        return 3 if isinstance(error, SolverError) else 2
    print(describe(table))
    return 0


def table_of(wave: Travelling) -> ModeTable:
    """Build the six-channel table: T at the wave's frequency, and the pair and the best wave in both directions.

    Raises InputError for more channels than the board has, or a frequency that it cannot play.
    """
    drivers, sensors = wave.table.actuator_count, wave.table.sensor_count
    if max(drivers, sensors) > CHANNELS:
        what = f"{drivers} actuators and {sensors} sensors, must be at most {CHANNELS} of each for the board"
        raise InputError(f"patches: {what}")
    matrix = structure(wave).sampled_matrix(wave.pair.frequency_hz)[:sensors, :drivers]
    return plate_table(
        matrix, wave.pair.frequency_hz, _tau_s(wave), wave.drives, float(np.exp(_log_metres(wave).mean()))
    )


def _log_metres(wave: Travelling) -> FloatArray:
    """ln of the wave's amplitude in m, rms in the window, per volt of the largest sensor: one for each pattern."""
    inside = wave.window[wave.line]
    motions = [np.linalg.norm(wave.field(volts)[inside]) / np.sqrt(inside.sum()) for volts in wave.drives.values()]
    return np.log(motions) - np.log([np.abs(wave.matrix @ volts).max() for volts in wave.drives.values()])


def structure(wave: Travelling) -> Structure:
    """Model of the plate for the emulated board: all modes of the table, unused channels at rest."""
    table, scale = wave.table, LARGEST / float(np.abs(wave.matrix).max())
    residual = np.zeros((CHANNELS, CHANNELS))
    assert table.sensor_residual is not None
    residual[: table.sensor_count, : table.actuator_count] = scale * table.sensor_residual
    return Structure(
        table.angular,
        float(np.median(table.quality_factor)),
        _padded(scale * table.actuators),
        _padded(table.sensors),
        residual,
        NOISE,
        SAMPLE_RATE_HZ,
    )


def board_outcome(wave: Travelling, log: Log, folder: Path | None, played: bool) -> dict[str, Any]:
    """Return the columns `tables`, the files written, and `board`, the patterns played by the emulated board.

    If the board cannot play the plate, both are omitted and the log gives the reason; requested playback raises InputError.
    """
    try:
        table = table_of(wave)
    except InputError as reason:
        if played:
            raise
        log.left_out("the six-channel board's table", "; ".join(reason.lines))
        return {}
    logs = _log_metres(wave)
    spread = 100.0 * float(np.expm1(np.abs(logs - logs.mean()).max()))
    log.info(
        f"six-channel table: {figure(float(np.exp(logs.mean())) / UM)} um rms in the window per volt of the largest sensor, "
        f"up to {figure(spread)} % more or less for single patterns"
    )
    results: dict[str, Any] = {}
    if folder is not None:
        results["tables"] = [path.name for path in export.write(table, folder, "travelling_wave")]
    if played and (board := _played(wave, table, log)) is not None:
        results["board"] = board
    return results


def patterns_of(wave: Travelling, drives: np.ndarray) -> list[PlayedPattern]:
    """Compare the wave that each pattern's drives (patterns, 6) produce on the plate with the requested one."""
    results = []
    for (name, target_volts), row in zip(wave.drives.items(), drives, strict=True):
        volts = row[: len(target_volts)]
        scale = np.vdot(target_volts, volts) / np.vdot(target_volts, target_volts)
        error = float(np.linalg.norm(volts - scale * target_volts) / np.linalg.norm(volts))
        results.append(PlayedPattern(name=name, twr=wave.twr(volts), twr_target=wave.twr(target_volts), error=error))
    return results


def _best(model: ShapedBeam, signal: Signal) -> tuple[float, ...]:
    scanned = scan(partial(model.matrix, signal=signal), np.linspace(*BAND_HZ, SCANNED))
    return tuple(float(f) for f in operating_frequencies(scanned, MAX_SHAPES))


def _tau_s(wave: Travelling) -> float:
    return float((wave.table.quality_factor / (pi * wave.table.frequencies_hz)).max())


def _padded(values: FloatArray) -> FloatArray:
    return np.pad(values, ((0, 0), (0, CHANNELS - values.shape[1])))


def _played(wave: Travelling, table: ModeTable, log: Log) -> list[PlayedPattern] | PlayFault | None:
    from firmware.build import BuildError
    from firmware.emulate import EmulationError, six_run

    seconds = max(MIN_S, PATTERN_TAUS * _tau_s(wave))
    try:
        with log.step("run the six-channel image on the emulated board"):
            drives = six_run(to_bytes(table), structure(wave), len(wave.drives), seconds)
    except BuildError as missing:
        if missing.exit_code != 5:
            raise
        log.left_out("the emulated six-channel board", str(missing))
        return None
    except EmulationError as error:
        log.warning("BOARD", f"emulated board: {error}")
        return PlayFault(fault=str(error))
    return patterns_of(wave, drives)


if __name__ == "__main__":
    sys.exit(main())
