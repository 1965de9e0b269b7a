"""`antinode active dq`: the loop of a case's or a table's mode, and the identification of a measured sweep."""

from __future__ import annotations

import csv
from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.active.options import compared, only_frequency_hz, quality_factor, seconds
from pipeline.board import table_file
from pipeline.board.table_file import ModeTable, TableError
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.measured.files import LARGEST
from pipeline.quantity import figure, frequency
from pipeline.records.reading import reading_table
from pipeline.units import MS, US
from pipeline.views.answer import Answer
from solvers.control.baseband import ModePlant
from solvers.control.dq_loop import Rates
from solvers.control.dq_study import DqData, DqStudy, dq_study
from solvers.control.identification import Identified, Sweep, identify

if TYPE_CHECKING:
    from solvers.control.identification import Sensor

WANTED_GAIN, OTHER_GAIN = 0.8, 0.04  # sensor over drive, full scales: where nothing was identified
COLUMNS = ("frequency_hz", "re", "im")


def dq(arguments: Namespace, case: Case | None, log: Log) -> Answer:
    """Study the loop of the mode that table, case or option names; with --sweep the mode is identified from a file."""
    from pipeline.active import plots_loop, thesis_models
    from pipeline.active.thesis import beside

    table = _table(arguments.table) if arguments.table else None
    data = _data(arguments, case, table, log)
    measured = identify(_sweep(arguments.sweep), data.sensor, data.delay_guess_s) if arguments.sweep else None
    if measured is not None:
        late = max(measured.delay_s - 0.5 / data.rates.sample_rate_hz, 0.0)  # beyond the hold's half sample
        data = replace(data, wanted=_velocity(measured.plant, data.sensor), delay_s=late)
    study = dq_study(data)
    comparison = beside("dq", thesis_models.dq(study))
    document = study.to_dict() | {"comparison": comparison, "measured": measured.to_dict() if measured else None}
    files = _new_table(table, measured, log) if table and measured else {}
    lines = [*_lines(study, measured), *compared(comparison)]
    return Answer(document, lines, pictures=lambda: plots_loop.report_figures(study), files=files)


def _table(path: str) -> ModeTable:
    try:
        return table_file.from_bytes(Path(path).read_bytes())
    except OSError as error:
        raise InputError(f"--table = {path}: {error.strerror}") from error
    except TableError as error:
        raise InputError(f"--table = {path}: {error}") from error


def _data(arguments: Namespace, case: Case | None, table: ModeTable | None, log: Log) -> DqData:
    data = DqData()
    if table is not None:
        data = _from_table(data, table, log)
    elif case is not None:
        case.require("plate", "zone", command="active dq without --table")
        data = replace(data, wanted=_from_case(case, log))
    plant = data.wanted
    frequency = only_frequency_hz(arguments, plant.frequency_hz)
    wanted = ModePlant.from_quality_factor(frequency, quality_factor(arguments, plant.quality_factor), plant.gain)
    delays = arguments.delay or ()
    if len(delays) > 1:
        raise InputError(f"--delay: active dq takes one, {len(delays)} came")
    return replace(
        data,
        wanted=wanted,
        within_s=seconds(arguments.settling_time, "--settling-time") if arguments.settling_time else data.within_s,
        delay_s=seconds(delays[0], "--delay") if delays else data.delay_s,
        delay_guess_s=seconds(delays[0], "--delay") if delays else data.delay_guess_s,
    )


def _from_case(case: Case, log: Log) -> ModePlant:
    from solvers.analytic.predesign import predesign

    zone = predesign(case.design).zone
    if zone is None:
        raise InputError(f"{case.name}: [plate], [zone]: too little is given to size the zone")
    log.info(
        f"mode by predesign, {frequency(zone.frequency_hz)}; gain {WANTED_GAIN} assumed; --table takes computed modes"
    )
    return ModePlant.from_quality_factor(zone.frequency_hz, case.quality_factor, WANTED_GAIN)


def _from_table(data: DqData, table: ModeTable, log: Log) -> DqData:
    if not table.modes:
        raise InputError("--table: it holds shapes only, no mode")
    sensor: Sensor = "displacement" if table.senses_displacement else "velocity"
    mode = table.modes[table.wanted]
    unknown = sum(one.gain is None for one in table.modes)
    if unknown:
        log.info(f"{unknown} gains of the table are not identified: {WANTED_GAIN} and {OTHER_GAIN} are assumed")
    plants = [_plant(one, i == table.wanted, sensor) for i, one in enumerate(table.modes)]
    late = mode.delay_s - 0.5 / table.sample_rate_hz
    known = late > 0.0
    return replace(
        data,
        wanted=plants[table.wanted],
        neighbours=tuple(plant for i, plant in enumerate(plants) if i != table.wanted),
        sensor=sensor,
        drive_limit=mode.drive_limit,
        amplitude_limit=mode.amplitude_limit,
        delay_s=late if known else data.delay_s,
        delay_guess_s=mode.delay_s if known else data.delay_guess_s,
        rates=Rates(sample_rate_hz=table.sample_rate_hz),
    )


def _plant(mode: table_file.Mode, wanted: bool, sensor: Sensor) -> ModePlant:
    if mode.gain is None:
        return ModePlant(mode.frequency_hz, mode.tau_s, WANTED_GAIN if wanted else OTHER_GAIN)
    return _velocity(ModePlant(mode.frequency_hz, mode.tau_s, mode.gain), sensor)


def _velocity(plant: ModePlant, sensor: Sensor) -> ModePlant:
    """The gain that a velocity sensor of the same size would show, real."""
    turned = 1j * plant.gain if sensor == "displacement" else plant.gain
    return replace(plant, gain=float(np.copysign(abs(turned), complex(turned).real)))


def _sweep(path: str) -> Sweep:
    """Read a file with the columns frequency_hz, re, im. Raises InputError with the line otherwise."""
    try:
        with Path(path).open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"--sweep = {path}: cannot be read ({error})") from error
    values = []
    for number, row in enumerate(rows, start=2):
        try:
            values.append([float(row[column]) for column in COLUMNS])
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"--sweep = {path}: line {number}: must hold {', '.join(COLUMNS)}") from error
    if not values:
        raise InputError(f"--sweep = {path}: no rows; columns must be {', '.join(COLUMNS)}")
    columns = np.array(values)
    if not (np.abs(columns) <= LARGEST).all() or not np.abs(columns[:, 1:]).max() > 1.0 / LARGEST:
        raise InputError(f"--sweep = {path}: must hold finite numbers within {LARGEST:g}, not all of them 0")
    return Sweep(columns[:, 0], columns[:, 1] + 1j * columns[:, 2])


def _new_table(table: ModeTable, identified: Identified, log: Log) -> dict[str, bytes]:
    """The table with its wanted mode as measured, as binary and as header of the same bytes."""
    plant = identified.plant
    mode = replace(
        table.modes[table.wanted],
        frequency_hz=plant.frequency_hz,
        tau_s=plant.tau_s,
        gain=plant.gain,
        delay_s=identified.delay_s,
        tau_identified=True,
        frequency_identified=True,
    )
    modes = tuple(mode if i == table.wanted else one for i, one in enumerate(table.modes))
    try:
        made = replace(table, modes=modes)
        files = {"mode_table.bin": table_file.to_bytes(made), "mode_table.h": table_file.to_header(made).encode()}
    except TableError as error:
        raise InputError(f"--sweep: what it shows does not fit a mode table: {error}") from error
    log.info("mode_table.bin and mode_table.h carry the measured mode (written with --out)")
    return files


def _lines(study: DqStudy, measured: Identified | None) -> list[str]:
    data, plant, design = study.data, study.identified.plant, study.to_dict()["design"]
    sampled = design["sampled"]
    head = ("name", "detuning_hz", "reference", "reached_95_s", "settled_5_s", "overshoot", "limited_periods")
    rows: list[list[Any]] = [[step.to_dict()[key] for key in head] for step in (*study.steps, *study.windups)]
    return [
        f"mode {frequency(data.wanted.frequency_hz)}, quality factor {data.wanted.quality_factor:g}, "
        f"{len(data.neighbours)} neighbours",
        f"identified from a simulated sweep{' of the measured mode' if measured else ''}: "
        f"{frequency(plant.frequency_hz)}, tau {figure(plant.tau_s / MS)} ms, "
        f"|G| {figure(abs(plant.gain))}, delay {figure(study.identified.delay_s / US)} us",
        f"continuous PI: K_p = {figure(study.pi.proportional)}, K_i = {figure(study.pi.integral_per_s)} 1/s for tau_d = "
        f"{data.response_s / MS:g} ms; each {sampled['period_s'] / US:g} us: K_p = {figure(sampled['proportional'])}, "
        f"integral {figure(sampled['integral'])}",
        f"margins: gain {figure(study.margins.gain)}, phase of the carrier {figure(study.margins.phase_deg)} degrees, "
        f"sensitivity {figure(study.margins.sensitivity)}",
        reading_table(head, rows),
    ]
