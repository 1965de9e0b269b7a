"""Mode table of the target mode and its neighbours for the firmware: a binary file and a C header with the same bytes.

The gains from actuators to sensors are modal residues with open sensors. With E = C + R_ss (clamped capacitance and
quasi-static residual), modes r of the plate with closed circuits, gains g_rp = phi_r' theta_p and
lambda_r' = lambda_r (1 + i/Q),

    (diag(lambda') + g_s E^-1 g_s' - lambda) q = g_d - g_s E^-1 R_sd,    V_s = -E^-1 (R_sd + g_s' q) per volt.

The eigenvalues mu are the modes with open sensors; near one, V_s/V = G/(1 + i tau (w - w0)), G = residue/(i Im mu).
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from firmware.mode_table import (
    CHANNELS,
    FREQUENCY_HIGH,
    FREQUENCY_LOW_HZ,
    GAIN,
    RATE_HZ,
    Mode,
    ModeTable,
    TableError,
    header_text,
    hold,
    to_bytes,
    why_not_played,
)
from geometry.elements import ComplexArray, FloatArray
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.modes import PartModes
from pipeline.quantity import figure, frequency
from pipeline.records.store import canonical_json, code_hash, write_atomic
from solvers.errors import SolverError

if TYPE_CHECKING:
    from solvers.piezo.forced import ForcedPlate


@dataclass(frozen=True)
class ModalGains:
    """The m modes with open sensors, ascending: frequency_hz (m,), tau_s (m,); target: index of the target mode.

    parts (m, drivers, sensors): G of each driver alone, driven by +1 V, at the mode's resonance, V/V, exp(i w t);
    signs (drivers,): signs with which all drivers push the target mode in the same direction.
    """

    frequency_hz: FloatArray
    tau_s: FloatArray
    parts: ComplexArray
    signs: FloatArray
    target: int

    @property
    def gain(self) -> ComplexArray:
        """Gain G of all drivers together with their signs, (m, sensors), V/V."""
        return np.einsum("mds,d->ms", self.parts, self.signs)


def can_be_computed(case: Case) -> bool:
    """Whether the case has both an actuator and a sensor patch."""
    patches = case.patches
    return patches is not None and bool(patches.sensors) and bool(patches.drivers)


def modal_gains(forced: ForcedPlate, near_hz: float | None = None) -> ModalGains:
    """Modes and gains of a plate with open sensors; the quasi-static residual is that at the target mode.

    Without a target mode, the one nearest to `near_hz` takes its place; SolverError if that is not given either. Modes that
    no driver excites or no sensor measures (|G| of every pair below 1e-6 V/V) are left out, except the target mode.
    """
    from solvers.piezo.forced import in_phase_signs

    values = np.concatenate([basis.eigenvalue for basis in forced.modes])
    gain = np.concatenate([basis.gain for basis in forced.modes])
    scale = forced.plate.scale.eigenvalue(1.0)
    tone = near_hz if forced.target_place() is None else forced.target_hz()
    if tone is None:
        raise SolverError("no mode of the plate with its patches has the target shape: the table needs one to drive")
    start = int(np.argmin(np.abs(values - scale * tone**2)))
    residual = sum(one.residual_gain[0] + (values[start] - one.middle) * one.residual_gain[1] for one in forced.modes)
    d, s = forced.drivers, forced.sensors
    clamped = np.diag(forced.plate.capacitance_f[s]) / forced.plate.stiffness_unit + residual[np.ix_(s, s)]
    listened = np.linalg.solve(clamped, gain[:, s].T)  # E^-1 g_s', (sensors, modes)
    system = np.diag(values * (1.0 + 1j * forced.losses)) + gain[:, s] @ listened
    mu, vectors = np.linalg.eig(system)
    vectors = vectors / np.sqrt(np.sum(vectors**2, axis=0))  # x'x = 1: the system is complex symmetric
    pushed = gain[:, d] - listened.T @ residual[np.ix_(s, d)]
    residues = np.einsum("dm,sm->mds", pushed.T @ vectors, -listened @ vectors)
    root = np.sqrt(mu / scale)
    parts = residues / (1j * mu.imag)[:, None, None]
    measurable = np.abs(parts).max(axis=(1, 2)) >= GAIN[0]
    target = int(np.argmax(np.abs(vectors[start])))
    order = [k for k in np.argsort(mu.real) if measurable[k] or k == target]
    return ModalGains(
        frequency_hz=np.sqrt(mu.real[order] / scale),
        tau_s=1.0 / (2.0 * pi * root.imag[order]),
        parts=parts[order],
        signs=in_phase_signs(gain[start], d)[d],
        target=order.index(target),
    )


SAMPLE_RATE_HZ = RATE_HZ["single"]
HOLD_S = 0.5 / SAMPLE_RATE_HZ  # half a sample: the only delay known before the filters are chosen
DRIVE_LIMIT = 0.85  # the DAC's buffer does not reach the rails
NEIGHBOURS = 6
ABOUT = 0.2  # of the target mode's frequency: half-width of the table's band if the plate was solved for another


def table_of(case: Case, frequencies_hz: list[float], qualities: Sequence[float | None], target: int) -> ModeTable:
    """Table of target mode and nearest neighbours, ascending; time constants from the quality factor, no gains.

    qualities: of each mode, where the case does not give one for all of them.
    """
    kept = _nearest(frequencies_hz, target)
    modes = tuple(
        Mode.from_quality_factor(
            frequencies_hz[i], case.quality_factor or qualities[i] or np.inf, delay_s=HOLD_S, drive_limit=DRIVE_LIMIT
        )
        for i in kept
    )
    return ModeTable(SAMPLE_RATE_HZ, design_hash(case.to_dict()), modes, kept.index(target))


def metres_per_volt(forced: ForcedPlate, gains: ModalGains) -> float:
    """Rms of u_z in the zone over the voltage of the first open sensor, at the target mode's resonance; 0 without voltage."""
    curve = forced.curve(gains.frequency_hz[[gains.target]])
    volts = float(np.abs(curve.sensor_v_per_v[0, 0]))
    return float(curve.zone_rms_m_per_v[0]) / volts if volts > 0.0 else 0.0


def table_with_gains(case: Case, gains: ModalGains, metres: float = 0.0) -> ModeTable:
    """Table of the patched plate with open sensors and gains in V/V at the patches; metres: per volt of the sensor.

    The gains assume that amplifier and conditioner multiply to one. They include the droop of the hold; its delay is a field
    of its own. PA4 drives the patches of positive sign, PA5, which gives the inverse, the others.
    """
    kept = _nearest(gains.frequency_hz.tolist(), gains.target)
    modes = tuple(_patched_mode(gains, i, metres if i == gains.target else 0.0) for i in kept)
    return ModeTable(SAMPLE_RATE_HZ, design_hash(case.to_dict()), modes, kept.index(gains.target))


def _patched_mode(gains: ModalGains, index: int, metres: float) -> Mode:
    frequency_hz = float(gains.frequency_hz[index])
    gain = complex(gains.gain[index, 0] * abs(hold(frequency_hz, SAMPLE_RATE_HZ)))
    too_small = max(abs(gain.real), abs(gain.imag)) < GAIN[0]
    polarities = sorted(set(gains.signs.tolist()), reverse=True)  # of the drivers: +1 is wired to PA4, -1 to PA5
    by_actuator = np.array([gains.parts[index, gains.signs == sign, 0].sum() for sign in polarities])
    return Mode(
        frequency_hz,
        float(gains.tau_s[index]),
        gain=None if too_small else gain,
        delay_s=HOLD_S,
        drive_limit=DRIVE_LIMIT,
        actuator_weights=_weights(by_actuator),
        sensor_weights=_weights(gains.gain[index, :CHANNELS]),
        metres_per_volt=metres,
    )


def _weights(values: np.ndarray) -> tuple[complex, ...]:
    largest = np.abs(values).max()
    turned = values / values[np.argmax(np.abs(values))] if largest > 0.0 else values
    return tuple(turned.tolist())


def _nearest(frequencies_hz: list[float], target: int) -> list[int]:
    """Target mode and the nearest of the others that the firmware can play, ascending."""
    low, high = FREQUENCY_LOW_HZ, FREQUENCY_HIGH * SAMPLE_RATE_HZ
    played = [i for i, hz in enumerate(frequencies_hz) if i == target or low <= hz <= high]
    by_distance = sorted(played, key=lambda i: abs(frequencies_hz[i] - frequencies_hz[target]))
    return sorted(by_distance[: NEIGHBOURS + 1])


def design_hash(about: object) -> bytes:
    """Return 16 bytes that identify a design, such as a case with its defaults, and the code that computed it."""
    return hashlib.sha256((canonical_json(about) + code_hash()).encode()).digest()[:16]


def write_table(
    case: Case,
    part_modes: PartModes,
    target: int,
    folder: Path,
    stem: str = "mode_table",
    log: Log | None = None,
    force: bool = False,
) -> list[Path]:
    """Write STEM.bin and STEM.h, which hold the same bytes.

    With a log, gains are computed for a case with an actuator and a sensor patch. Otherwise the board identifies them, and
    nothing is computed. force: as in `write_gains`.
    """
    if log is not None:
        if can_be_computed(case):
            return write_gains(case, folder, log, stem, None, part_modes.rows[target].frequency_hz if force else None)
        log.info("mode table: no gains, since they need an actuator and a sensor patch; the board identifies them")
    tones, qualities = ([getattr(row, name) for row in part_modes.rows] for name in ("frequency_hz", "quality_factor"))
    return write(table_of(case, tones, qualities, target), folder, stem)


def write_gains(
    case: Case,
    folder: Path,
    log: Log,
    stem: str = "mode_table",
    forced: ForcedPlate | None = None,
    near_hz: float | None = None,
) -> list[Path]:
    """Write STEM.bin and STEM.h of the patched plate with computed gains, and log the gains and the wiring.

    forced: plate that a response has solved already; near_hz: frequency of the mode to drive if the patched plate has no
    target mode. Raises InputError for such a plate without it.
    """
    from pipeline.models.forced import forced_plate

    plate = forced or forced_plate(case, log)
    if plate.target_place() is None:
        plate = _about(case, plate, _instead_hz(case, plate, near_hz, log), log)
    gains = modal_gains(plate, near_hz)
    table = table_with_gains(case, gains, metres_per_volt(plate, gains))
    _log_summary(case, gains, table, log)
    return write(table, folder, stem)


def write_patched(case: Case, forced: ForcedPlate, folder: Path, log: Log, stem: str = "mode_table") -> list[Path]:
    """Write STEM.bin and STEM.h of a solved patched plate with a target mode.

    With an actuator and a sensor patch, the table has gains; otherwise it has the resonances of the plate as wired.
    """
    from solvers.piezo.responses import driven_hz, resonances_hz

    if can_be_computed(case):
        return write_gains(case, folder, log, stem, forced)
    near_hz = forced.target_hz()
    assert near_hz is not None
    plate = _about(case, forced, near_hz, log)
    tone, resonances = driven_hz(plate), resonances_hz(plate)
    assert tone is not None
    target = int(np.argmin(np.abs(resonances - tone)))
    qualities = [1.0 / plate.loss_at(each) for each in resonances]
    return write(table_of(case, resonances.tolist(), qualities, target), folder, stem)


def _instead_hz(case: Case, forced: ForcedPlate, near_hz: float | None, log: Log) -> float:
    """Return the frequency of the mode to drive if the band of the patched plate does not contain its target mode."""
    lacks = f"{case.name}: no mode of the plate with its patches has the target shape"
    if near_hz is not None:
        log.warning("TABLE", f"{lacks} in the band; the table drives the mode nearest to {frequency(near_hz)} instead")
        return near_hz
    tone = forced.target_hz()
    if tone is None:
        raise InputError(
            f"{lacks}. A table would drive another mode: change the design or the patches, or use the mode nearest to that of "
            "the plate without patches with --force"
        )
    return tone


def _about(case: Case, forced: ForcedPlate, tone: float, log: Log) -> ForcedPlate:
    """Return the plate, solved again around a frequency that lies outside its band."""
    from pipeline.models.forced import forced_plate

    if forced.band_hz[0] < tone < forced.band_hz[1]:
        return forced
    return forced_plate(case, log, ((1.0 - ABOUT) * tone, (1.0 + ABOUT) * tone))


def _log_summary(case: Case, gains: ModalGains, table: ModeTable, log: Log) -> None:
    assert case.patches is not None
    mode = table.modes[table.target]
    if mode.gain is None:
        log.info("mode table: no gain, since the sensor does not measure the target mode")
    else:
        angle = figure(float(np.degrees(np.angle(mode.gain))))
        log.info(
            f"mode table: gain {figure(abs(mode.gain))} V/V at {angle} degrees (computed at {frequency(mode.frequency_hz)} "
            "with the patches on, without amplifier and conditioner); the board measures it again"
        )
    if mode.metres_per_volt:
        log.info(f"mode table: {figure(1e6 * mode.metres_per_volt)} um rms in the zone per volt of the sensor")
    for sign, pin in ((1.0, "PA4"), (-1.0, "PA5")):
        group = [str(patch) for patch, has in zip(case.patches.drivers, gains.signs, strict=True) if has == sign]
        if group:
            log.info(f"wiring: patches {', '.join(group)} on {pin}")


def places(folder: Path, stem: str) -> list[Path]:
    """Files of a table: STEM.bin and STEM.h."""
    return [folder / f"{stem}.bin", folder / f"{stem}.h"]


def write(table: ModeTable, folder: Path, stem: str) -> list[Path]:
    """Write a table as STEM.bin and STEM.h. Raises InputError for a plate whose modes the firmware cannot play."""
    files = places(folder, stem)
    try:
        data, refusal = to_bytes(table), why_not_played(table)
    except TableError as error:
        raise InputError(f"mode table: {error}: the firmware cannot play this mode") from error
    if refusal:
        raise InputError(f"mode table: {refusal}: the firmware cannot play this mode")
    for file, content in zip(files, (data, header_text(data).encode()), strict=True):
        write_atomic(file, content)
    return files
