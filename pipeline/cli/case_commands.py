"""One function per command that takes a case: read it, solve, tell."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

from pipeline.case.model import Case, load_case
from pipeline.case.quantities import parse_band, parse_frequency
from pipeline.errors import CheckFailed, InputError
from pipeline.logs import TerminalLog
from pipeline.paths import STUDIES
from pipeline.records import outputs
from pipeline.views import files
from pipeline.views.rows import ROWS


def _case(arguments: Namespace) -> Case:
    case = outputs.of_case(arguments, load_case(arguments.case, arguments.set))
    outputs.check_places(arguments)  # once more: now it is known what else the case reads
    return case


def _log(arguments: Namespace) -> TerminalLog:
    return TerminalLog(arguments.quiet)


def predesign(arguments: Namespace) -> int:
    """Size zone and pillar analytically."""
    from pipeline.analysis.predesign import run, short_wave

    case = _case(arguments)
    case.require("plate", "zone", command="predesign")
    if warning_text := short_wave(case.design):
        _log(arguments).warning("SHORT_WAVE", warning_text)
    document, text = run(case)
    rows = [list(row.values()) for row in ROWS["predesign"](document)]
    files.emit(arguments, "predesign", document, text, ("part", "quantity", "value"), rows)
    return 0


def modes(arguments: Namespace) -> int:
    """Compute the modes of a part."""
    _refuse_options_without_effect(arguments)
    case, log = _case(arguments), _log(arguments)
    band = parse_band(arguments.band, "--band") if arguments.band else None
    near = parse_frequency(arguments.near, "--near") if arguments.near else None
    from pipeline.planning.request import Request

    query = Request(arguments.part, band, near, arguments.count, arguments.symmetry)
    if arguments.explain:
        if arguments.mesh_file:
            raise InputError("--explain: must be left out beside --mesh-file, whose mesh is solved whole as it is")
        _require_part(case, arguments.part)
        return _explained(arguments, "of_modes", case, query)
    if arguments.save_all_fields and not arguments.out:
        raise InputError("--save-all-fields: needs --out DIR, the folder that fields.npz goes to")
    from pipeline.analysis import wanted_text
    from pipeline.analysis.modes import solve_modes

    if arguments.mesh_file:
        from pipeline.exchange import user_mesh

        part_modes = user_mesh.solve(case, arguments.mesh_file, arguments.unit or "m", arguments.clamp, query, log)
    else:
        _require_part(case, arguments.part)
        part_modes = solve_modes(case, query, log)
    document = part_modes.record.to_dict() | {"seconds": log.seconds | {"total": log.elapsed}}
    head = ("frequency_hz", "symmetry", "zone_share", "confinement_db", "mac", "strength", "residual")
    rows = [[getattr(row, key) for key in head] for row in part_modes.rows]
    text = [
        f"{part_modes.model.name}, {part_modes.dof} degrees of freedom, {part_modes.rigid_count} rigid-body modes",
        outputs.table(head, rows),
    ]
    text += wanted_text.lines(part_modes, case.design)
    files.emit(arguments, "modes", document, "\n".join(text), head, rows)
    if arguments.save_all_fields:
        from pipeline.analysis import mode_fields
        from pipeline.records import store

        store.save_arrays(outputs.folder(arguments.out), mode_fields.full_fields(part_modes), store.FIELDS)
    return 0


def _refuse_options_without_effect(arguments: Namespace) -> None:
    """Raise InputError for options of `modes` that would have no effect beside the others."""
    lines = []
    if arguments.near and arguments.band:
        lines.append(
            f"--near = {arguments.near}: must be left out beside --band, which asks for every mode between its ends"
        )
    if not arguments.mesh_file:
        if arguments.unit:
            lines.append(f"--unit = {arguments.unit}: needs --mesh-file FILE, whose lengths it is for")
        lines += [f"--clamp = {name}: needs --mesh-file FILE, one of whose groups it names" for name in arguments.clamp]
    if lines:
        raise InputError(lines)


def _require_part(case: Case, part: str) -> None:
    if part == "plate":
        case.require_plate(command="modes --part plate")
    elif part == "zone":
        case.require("plate", "zone", command="modes --part zone")
    else:
        case.require("pillar", command="modes --part pillar")


def _explained(arguments: Namespace, which: str, *about: Any) -> int:
    """Print the plan of a command instead of following it."""
    from pipeline.planning import plan

    planned = getattr(plan, which)(*about)
    outputs.emit(arguments, "plan", planned.to_dict(), planned.text())
    return 0


def bands(arguments: Namespace) -> int:
    """Compute Bloch bands and complete gaps."""
    case, log = _case(arguments), _log(arguments)
    if arguments.explain:
        return _explained(arguments, "of_bands", case)
    from pipeline.analysis.bands import solve_bands

    computed = solve_bands(case, log)
    document = computed.record.to_dict() | {"seconds": log.seconds | {"total": log.elapsed}}
    count = computed.frequencies_hz.shape[1]
    head = ("label", "kx_per_m", "ky_per_m", *(f"band_{n}_hz" for n in range(1, count + 1)))
    rows = [
        [label, float(k[0]), float(k[1]), *(float(f) for f in row)]
        for label, k, row in zip(computed.path.labels, computed.path.wavevectors, computed.frequencies_hz, strict=True)
    ]
    labelled = [row for row in rows if row[0]]
    gaps = [
        f"Gap from band {g.lower_band} ({g.lower_hz / 1e3:.2f} kHz) to band {g.upper_band} ({g.upper_hz / 1e3:.2f} kHz), "
        f"{200 * (g.upper_hz - g.lower_hz) / (g.upper_hz + g.lower_hz):.2f} %"
        for g in computed.gaps
    ] or ["No complete gap along the path"]
    text = [f"{computed.model}, {computed.dof} degrees of freedom a wavevector", outputs.table(head, labelled), *gaps]
    if computed.expected_error is not None:
        text.append(f"expected error of a frequency: {computed.expected_error:.2%} by the mesh")
    files.emit(arguments, "bands", document, "\n".join(text), head, rows)
    return 0


def check_gap(arguments: Namespace) -> int:
    """Compare the band-gap edges with the committed ones."""
    arguments.case = arguments.case or str(STUDIES / "three-rows.toml")
    case, log = _case(arguments), _log(arguments)
    from pipeline.cli import check_gap

    edges = check_gap.check_gap(case, log)
    document = check_gap.to_dict(edges)
    head = ("edge", "reference_hz", "found_hz", "change", "allowed", "holds")
    rows = [
        [
            e.name,
            e.reference_hz,
            e.found_hz,
            None if e.relative_change is None else f"{100 * e.relative_change:+.3f} %",
            f"{100 * e.allowed:.1f} %",
            e.holds,
        ]
        for e in edges
    ]
    outputs.emit(arguments, "check-gap", document, outputs.table(head, rows))
    if not document["holds"]:
        raise CheckFailed(e.words for e in edges if not e.holds)
    return 0


def attenuation(arguments: Namespace) -> int:
    """Compute the decay per row."""
    case, log = _case(arguments), _log(arguments)
    band = parse_band(arguments.band, "--band") if arguments.band else None
    if arguments.explain:
        return _explained(arguments, "of_attenuation", case, band, arguments.kx, arguments.points, bool(arguments.out))
    from pipeline.analysis import attenuation as rows

    computed = rows.solve(case, log, band, arguments.kx, arguments.points)
    document = computed.to_dict() | {"seconds": log.seconds | {"total": log.elapsed}}
    head = ("frequency_hz", "db_per_row", "reflected", "passed_flexural", "passed_shear", "passed_longitudinal")
    table = [_attenuation_row(point) for point in computed.points]
    step = max(1, len(table) // 20)
    text = [
        f"{computed.model}, kx = {computed.kx_per_m:.1f} rad/m; decay of the least attenuated flexural wave, and shares of an "
        f"incoming flexural wave's power after {computed.rows} rows",
        outputs.table(head, table[::step]),
    ]
    files.emit(arguments, "attenuation", document, "\n".join(text), head, table)
    if arguments.out:
        from pipeline.plots import style
        from pipeline.plots.attenuation import complex_bands

        folder = outputs.folder(arguments.out)
        with style.style():
            style.save(complex_bands(computed), folder)
    return 0


def _attenuation_row(point: Any) -> list[Any]:
    passed = point.through_rows
    shares = [None] * 4 if passed is None else [passed.reflected, passed.flexural, passed.shear, passed.longitudinal]
    return [point.frequency_hz, point.db_per_row, *shares]


def response(arguments: Namespace) -> int:
    """Compute the forced response."""
    case, log = _case(arguments), _log(arguments)
    band = parse_band(arguments.band, "--band") if arguments.band else None
    if arguments.explain:
        return _explained(arguments, "of_response", case, band, arguments.points, bool(arguments.out))
    from pipeline.analysis import response as forced
    from pipeline.measured import comparison, synthetic

    measured = comparison.read(case, arguments.measured, arguments.map, arguments.at)
    computed = forced.solve(case, log, band, arguments.points)
    beside = comparison.compare(case, computed, measured, log) if measured else None
    made = synthetic.write(arguments, case, computed) if arguments.synthetic_data else []
    document = computed.record.to_dict() | ({"measured": beside.record.to_dict()} if beside else {})
    document |= {"seconds": log.seconds | {"total": log.elapsed}}
    head, rows = _response_table(document)
    peak_hz = computed.peak.frequency_hz
    near = sorted(range(len(rows)), key=lambda i: abs(rows[i][0] - peak_hz))[:15]
    text = [
        f"{computed.model}, {computed.dof} degrees of freedom; around the peak of "
        f"the {'wanted mode' if computed.wanted else 'zone'}, "
        "per volt of drive:",
        outputs.table(head, [rows[i] for i in sorted(near)]),
        *forced.lines(computed),
        *(beside.lines if beside else []),
        *(f"wrote {path}" for path in made),
    ]
    files.emit(arguments, "response", document, "\n".join(text), head, rows)
    if arguments.out:
        from pipeline.plots import style
        from pipeline.plots.response import curves

        folder = outputs.folder(arguments.out)
        with style.style():
            style.save(curves(computed.record, computed.shape_points, computed.shape), folder)
            if beside:
                from pipeline.plots.measured import report_figure
                from pipeline.records.record import DesignRecord

                style.save(report_figure(beside.record, beside.arrays, DesignRecord.of_design(case.design)), folder)
    return 0


def _response_table(document: dict[str, Any]) -> tuple[tuple[str, ...], list[list[Any]]]:
    head = ("frequency_hz", "zone_rms_m_per_V", "passive_rms_m_per_V", "sensor_re", "sensor_im")
    count = len(document["frequency_hz"])
    passive = document["passive_rms_m_per_V"] or [None] * count
    sensor = document["sensor_V_per_V"] or [[None, None]] * count
    columns = zip(document["frequency_hz"], document["zone_rms_m_per_V"], passive, sensor, strict=True)
    return head, [[f, zone, passive_rms, *pair] for f, zone, passive_rms, pair in columns]


def active(arguments: Namespace) -> int:
    """Run an analogy or control model."""
    from pipeline.active.models import run

    return run(arguments)


def export(arguments: Namespace) -> int:
    """Write files for other programs."""
    case, log = _case(arguments), _log(arguments)
    from pipeline.exchange import exports

    if arguments.part == "plate":
        case.require_plate(command=f"export {arguments.format}")
    else:
        _require_part(case, arguments.part)
    outputs.check_apart(arguments.json, arguments.output)
    written = exports.write(case, arguments.format, arguments.output, log, arguments.part, arguments.force)
    document = {"schema": 1, "files": [str(path) for path in written]}
    outputs.emit(arguments, "export", document, "\n".join(f"wrote {path}" for path in written))
    return 0
