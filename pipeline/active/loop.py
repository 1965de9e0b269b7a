"""Mode of the control loop under study: from a mode table, from a case, or identified from a measured sweep."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from firmware import mode_table
from firmware.mode_table import ModeTable, TableError
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.quantity import frequency
from pipeline.records.outputs import write_file
from solvers.control.identification import Identified
from solvers.control.loop import ModePlant, Rates
from solvers.thesis.loop_design import DqData

if TYPE_CHECKING:
    from solvers.control.identification import Sensor

TARGET_GAIN, OTHER_GAIN = 0.8, 0.04  # sensor over drive, full scales: assumed for unidentified modes


def read_table(path: str) -> ModeTable:
    try:
        return mode_table.from_bytes(Path(path).read_bytes())
    except OSError as error:
        raise InputError(f"--table = {path}: {error.strerror}") from error
    except TableError as error:
        raise InputError(f"--table = {path}: {error}") from error


def of_case(case: Case, log: Log) -> ModePlant:
    from solvers.analytic.predesign import predesign

    zone = predesign(case.design).zone
    if zone is None:
        raise InputError(f"{case.name}: [plate], [zone]: too few values to size the zone")
    log.info(
        f"mode: {frequency(zone.frequency_hz)} (predesign), gain {TARGET_GAIN} (assumed); use --table for computed modes"
    )
    return ModePlant.from_quality_factor(zone.frequency_hz, case.one_quality_factor("active dq"), TARGET_GAIN)


def of_table(data: DqData, table: ModeTable, log: Log) -> DqData:
    if not table.modes:
        raise InputError("--table: must contain a mode, this table has shapes only")
    sensor: Sensor = "displacement" if table.senses_displacement else "velocity"
    mode = table.modes[table.target]
    unknown = sum(one.gain is None for one in table.modes)
    if unknown:
        log.info(f"unidentified gains of the table: {unknown}, set to {TARGET_GAIN} and {OTHER_GAIN} (assumed)")
    plants = [plant_of(one, i == table.target, sensor) for i, one in enumerate(table.modes)]
    late = mode.delay_s - 0.5 / table.sample_rate_hz
    known = late > 0.0
    return replace(
        data,
        target=plants[table.target],
        neighbours=tuple(plant for i, plant in enumerate(plants) if i != table.target),
        sensor=sensor,
        drive_limit=mode.drive_limit,
        amplitude_limit=mode.amplitude_limit,
        delay_s=late if known else data.delay_s,
        delay_guess_s=mode.delay_s if known else data.delay_guess_s,
        rates=Rates(sample_rate_hz=table.sample_rate_hz),
    )


def plant_of(mode: mode_table.Mode, target: bool, sensor: Sensor) -> ModePlant:
    if mode.gain is None:
        return ModePlant(mode.frequency_hz, mode.tau_s, TARGET_GAIN if target else OTHER_GAIN)
    return velocity_of(ModePlant(mode.frequency_hz, mode.tau_s, mode.gain), sensor)


def velocity_of(plant: ModePlant, sensor: Sensor) -> ModePlant:
    """Convert the gain to that of a velocity sensor of the same magnitude, which is real."""
    turned = 1j * plant.gain if sensor == "displacement" else plant.gain
    return replace(plant, gain=float(np.copysign(abs(turned), complex(turned).real)))


def write_table(table: ModeTable, identified: Identified, folder: Path | None, log: Log) -> None:
    """Write the table with its measured target mode into a folder, as binary and as a header with the same bytes."""
    plant = identified.plant
    mode = replace(
        table.modes[table.target],
        frequency_hz=plant.frequency_hz,
        tau_s=plant.tau_s,
        gain=plant.gain,
        delay_s=identified.delay_s,
        tau_identified=True,
        frequency_identified=True,
    )
    modes = tuple(mode if i == table.target else one for i, one in enumerate(table.modes))
    try:
        made = replace(table, modes=modes)
        data = mode_table.to_bytes(made)
        files = {"mode_table.bin": data, "mode_table.h": mode_table.header_text(data).encode()}
    except TableError as error:
        raise InputError(f"--sweep: the measured mode does not fit into a mode table: {error}") from error
    log.info("mode_table.bin and mode_table.h contain the measured mode (written with --out)")
    if folder:
        for name, data in files.items():
            write_file(folder / name, data)
