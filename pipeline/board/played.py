"""A travelling wave on the six-channel board: its mode table, and the unmodified image playing it on the emulated board."""

from __future__ import annotations

from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from firmware.emulate.beam import Structure
from firmware.mode_table import CHANNELS, ModeTable, to_bytes
from geometry.elements import FloatArray
from pipeline.board import export
from pipeline.board.shaping import LARGEST, SAMPLE_RATE_HZ, plate_table
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.travel_parts import PlayedPattern, PlayFault
from pipeline.models.travelling import Travelling

NOISE = 1e-3  # of full scale, at every sensor
PATTERN_TAUS = 12.0  # decay times that each pattern is held
MIN_S = 0.3


def table_of(wave: Travelling) -> ModeTable:
    """The six-channel table: T at the wave's frequency, the pair both ways and the largest travelling-wave ratio both ways.

    Raises InputError for more channels than the board has, or a frequency that it does not play.
    """
    drivers, sensors = wave.table.actuator_count, wave.table.sensor_count
    if max(drivers, sensors) > CHANNELS:
        what = f"{drivers} drive and {sensors} listen, the board has {CHANNELS} channels of each"
        raise InputError(f"patches: {what}")
    matrix = structure(wave).sampled_matrix(wave.pair.frequency_hz)[:sensors, :drivers]
    return plate_table(matrix, wave.pair.frequency_hz, _tau_s(wave), wave.drives)


def _tau_s(wave: Travelling) -> float:
    return float((wave.table.quality_factor / (pi * wave.table.frequencies_hz)).max())


def structure(wave: Travelling) -> Structure:
    """The plate as the emulated board moves it: all modes of the table, channels that are not in use at rest."""
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


def _padded(values: FloatArray) -> FloatArray:
    return np.pad(values, ((0, 0), (0, CHANNELS - values.shape[1])))


def board_outcome(wave: Travelling, log: Log, folder: Path | None, played: bool) -> dict[str, Any]:
    """Return the columns `tables`, where the table went, and `board`, how the emulated board played each pattern.

    A plate that the board cannot play leaves both out and says why, unless playing was asked for.
    """
    try:
        table = table_of(wave)
    except InputError as reason:
        if played:
            raise
        log.left_out("the six-channel board's table", "; ".join(reason.lines))
        return {}
    results: dict[str, Any] = {}
    if folder is not None:
        results["tables"] = [path.name for path in export.write(table, folder, "travelling_wave")]
    if played and (board := _played(wave, table, log)) is not None:
        results["board"] = board
    return results


def _played(wave: Travelling, table: ModeTable, log: Log) -> list[PlayedPattern] | PlayFault | None:
    from firmware.build import BuildError
    from firmware.emulate import EmulationError, six_run

    seconds = max(MIN_S, PATTERN_TAUS * _tau_s(wave))
    try:
        with log.step("the six-channel image on the emulated board"):
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


def patterns_of(wave: Travelling, drives: np.ndarray) -> list[PlayedPattern]:
    """The wave that each pattern's drives (patterns, 6) make on the plate, beside the one asked for."""
    results = []
    for (name, target_volts), row in zip(wave.drives.items(), drives, strict=True):
        volts = row[: len(target_volts)]
        scale = np.vdot(target_volts, volts) / np.vdot(target_volts, target_volts)
        error = float(np.linalg.norm(volts - scale * target_volts) / np.linalg.norm(volts))
        results.append(PlayedPattern(name=name, twr=wave.twr(volts), twr_target=wave.twr(target_volts), error=error))
    return results
