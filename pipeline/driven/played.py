"""A travelling wave on the six-channel board: its mode table, and the unmodified image playing it on the emulated board."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np

from firmware.emulate.beam import Structure
from firmware.table_format import CHANNELS
from geometry.elements import FloatArray
from pipeline.board import export
from pipeline.board.shaping import LARGEST, SAMPLE_RATE_HZ, plate_table
from pipeline.board.table_file import ModeTable, to_bytes
from pipeline.driven.travelling import Travelling
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.records.record import BoardFault, PlayedPattern, TravelRecord

NOISE = 1e-3  # of full scale, at every sensor
HELD_TAUS = 12.0  # decay times that each pattern is held
MIN_S = 0.3


def table_of(held: Travelling) -> ModeTable:
    """The six-channel table: T at the wave's frequency, the pair both ways and the largest travelling-wave ratio both ways.

    Raises InputError for more channels than the board has, or a frequency that it does not play.
    """
    drivers, sensors = held.table.actuator_count, held.table.sensor_count
    if max(drivers, sensors) > CHANNELS:
        what = f"{drivers} drive and {sensors} listen, the board has {CHANNELS} channels of each"
        raise InputError(f"patches: {what}")
    matrix = structure(held).sampled_matrix(held.pair.frequency_hz)[:sensors, :drivers]
    return plate_table(matrix, held.pair.frequency_hz, _tau_s(held), held.drives)


def _tau_s(held: Travelling) -> float:
    return float((held.table.quality / (pi * held.table.frequencies_hz)).max())


def structure(held: Travelling) -> Structure:
    """The plate as the emulated board moves it: all modes of the table, channels that are not in use at rest."""
    table, scale = held.table, LARGEST / float(np.abs(held.matrix).max())
    residual = np.zeros((CHANNELS, CHANNELS))
    assert table.sensor_residual is not None
    residual[: table.sensor_count, : table.actuator_count] = scale * table.sensor_residual
    return Structure(
        table.angular,
        float(np.median(table.quality)),
        _padded(scale * table.actuators),
        _padded(table.sensors),
        residual,
        NOISE,
        SAMPLE_RATE_HZ,
    )


def _padded(values: FloatArray) -> FloatArray:
    return np.pad(values, ((0, 0), (0, CHANNELS - values.shape[1])))


def board_outcome(
    held: Travelling, log: Log, folder: Path | None, played: bool
) -> dict[str, list[str] | list[PlayedPattern] | BoardFault]:
    """What a record keeps of the board: where the table went, and how the emulated board played each pattern.

    A plate that the board cannot play leaves both out and says why, unless playing was asked for.
    """
    try:
        table = table_of(held)
    except InputError as reason:
        if played:
            raise
        log.left_out("the six-channel board's table", "; ".join(reason.lines))
        return {}
    found: dict[str, list[str] | list[PlayedPattern] | BoardFault] = {}
    if folder is not None:
        found["tables"] = [path.name for path in export.write(table, folder, "travelling_wave")]
    if played and (board := _played(held, table, log)) is not None:
        found["board"] = board
    return found


def _played(held: Travelling, table: ModeTable, log: Log) -> list[PlayedPattern] | BoardFault | None:
    from firmware.build import BuildError
    from firmware.emulate import EmulationError, six_run

    seconds = max(MIN_S, HELD_TAUS * _tau_s(held))
    try:
        with log.step("the six-channel image on the emulated board"):
            run = six_run(to_bytes(table), structure(held), len(held.drives), seconds)
    except BuildError as missing:
        if missing.exit_code != 5:
            raise
        log.left_out("the emulated six-channel board", str(missing))
        return None
    except EmulationError as error:
        log.warning("BOARD", f"emulated board: {error}")
        return BoardFault(fault=str(error))
    return patterns_of(held, run.drives)


def patterns_of(held: Travelling, drives: np.ndarray) -> list[PlayedPattern]:
    """The wave that each pattern's drives (patterns, 6) make on the plate, beside the one asked for."""
    found = []
    for (name, asked), row in zip(held.drives.items(), drives, strict=True):
        volts = row[: len(asked)]
        scale = np.vdot(asked, volts) / np.vdot(asked, asked)
        error = float(np.linalg.norm(volts - scale * asked) / np.linalg.norm(volts))
        found.append(PlayedPattern(name=name, twr=held.twr(volts), twr_target=held.twr(asked), error=error))
    return found


def lines(record: TravelRecord) -> list[str]:
    """What the board played, in words."""
    if record.board is None or isinstance(record.board, BoardFault):
        return []
    return [
        f"emulated board, {each.name}: travelling-wave ratio {each.twr:.3f} where {each.twr_target:.3f} is asked for, "
        f"drives off by {each.error:.1%}"
        for each in record.board
    ]
