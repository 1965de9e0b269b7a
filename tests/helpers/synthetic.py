"""Synthetic records of a study, with closed-form fields on box skins, for tests of pictures and pages."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.models.answer_parts import (
    AttenuationPoint,
    CountRecord,
    ModeRecord,
    RivalRecord,
    TargetMode,
    TargetRecord,
    Transmission,
    Wave,
)
from pipeline.questions.attenuation import AttenuationResult, PredictionResult
from pipeline.questions.bands import BandPoint, BandsResult, Gap
from pipeline.questions.board import BoardResult
from pipeline.questions.geometry import GeometryResult
from pipeline.questions.modes import ModesResult
from pipeline.questions.response import PeakRecord, ResponseResult
from pipeline.questions.tetrahedra import TetModesResult
from pipeline.records import record as stored
from pipeline.records import store
from pipeline.records.record import (
    DesignRecord,
    KeysRecord,
    MeshRecord,
    PillarRecord,
    Record,
)
from pipeline.records.study import StoredCase

LENGTH, WIDTH, THICKNESS, SIDE, HEIGHT = 0.1155, 0.020, 0.002, 0.002, 0.0063
ALUMINIUM = {"name": "aluminium", "young_pa": 70e9, "density_kg_m3": 2700.0, "poisson": 0.34}


def design(rows: int, pitch: float, extension: float) -> DesignRecord:
    """A record's design."""
    half = WIDTH / 2 + ((rows - 1) * pitch + SIDE if rows else 0.0) + extension
    columns = int((LENGTH - SIDE) / pitch + 1e-9) + 1
    x = (np.arange(columns) - (columns - 1) / 2) * pitch
    y = WIDTH / 2 + SIDE / 2 + pitch * np.arange(rows)
    centres = [[float(a), float(b)] for b in [*-y[::-1], *y] for a in x]
    pillar = PillarRecord(shape="square", base_m=SIDE, tip_m=SIDE, height_m=HEIGHT, fillet_m=0.0)
    return DesignRecord(
        length_m=LENGTH,
        width_m=WIDTH,
        thickness_m=THICKNESS,
        half_span_m=half,
        rows=rows,
        pitch_x_m=pitch,
        pitch_y_m=pitch,
        extension_m=extension,
        nodal_lines=8,
        pillar=pillar if rows else None,
        pillar_centres_m=centres if rows else [],
    )


def keys(shape: DesignRecord) -> KeysRecord:
    """Keys of a design whose case differs from others in the design alone."""
    plate = shape.model_dump_json()
    return KeysRecord(plate=plate, plate_modes=plate, cell_bands=f"{shape.pitch_x_m} {shape.pitch_y_m} {shape.pillar}")


def grid(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 2) and quads (m, 4) of a rectangle."""
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    index = np.arange(points.shape[0]).reshape(x.size, y.size)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1)
    return points, quads.reshape(-1, 4)


def box(low: np.ndarray, high: np.ndarray, steps: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Skin of a box, six gridded faces."""
    points, quads, offset = [], [], 0
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        lines = [np.linspace(low[o], high[o], steps[o] + 1) for o in others]
        for level in (low[axis], high[axis]):
            flat, cells = grid(*lines)
            face = np.full((flat.shape[0], 3), level)
            face[:, others] = flat
            points.append(face)
            quads.append(cells + offset)
            offset += face.shape[0]
    return np.concatenate(points), np.concatenate(quads)


def skin(shape: DesignRecord, step: float = 0.0015) -> tuple[np.ndarray, np.ndarray]:
    """Skin of the plate and its pillars (their feet are not cut out)."""
    half = np.array([LENGTH / 2, shape.half_span_m, 0.0])
    counts = np.maximum(1, np.round(2 * half / step).astype(int))
    parts = [box(-half, half + np.array([0, 0, THICKNESS]), (counts[0], counts[1], 2))]
    for x, y in shape.pillar_centres_m:
        low = np.array([x - SIDE / 2, y - SIDE / 2, THICKNESS])
        parts.append(box(low, low + np.array([SIDE, SIDE, HEIGHT]), (2, 2, 6)))
    offsets = np.cumsum([0, *(len(points) for points, _ in parts)])
    return np.concatenate([p for p, _ in parts]), np.concatenate(
        [q + o for (_, q), o in zip(parts, offsets[:-1], strict=True)]
    )


def normal_motion(xy: np.ndarray, lines: int, decay: float) -> np.ndarray:
    """A (0, lines) shape that decays outside the zone."""
    along = np.cos((lines - 0.5) * np.pi * xy[:, 0] / LENGTH)
    beyond = np.maximum(0.0, np.abs(xy[:, 1]) - WIDTH / 2)
    return (
        along
        * np.where(beyond > 0, 0.25 * np.cos(400 * beyond), np.cos(np.pi * xy[:, 1] / WIDTH))
        * np.exp(-decay * beyond)
    )


def motion(points: np.ndarray, lines: int, decay: float) -> np.ndarray:
    """Displacement (n, 3): plate bending, pillars swinging with height."""
    lift = np.maximum(0.0, points[:, 2] - THICKNESS) / HEIGHT
    normal = normal_motion(points[:, :2], lines, decay)
    wave = (lines - 0.5) * np.pi / LENGTH
    fade = np.exp(-decay * np.maximum(0, np.abs(points[:, 1]) - WIDTH / 2))
    swing = 6 * lift**2 * fade
    u = np.zeros_like(points)
    u[:, 0] = -0.6 * swing * np.sin(wave * points[:, 0])
    u[:, 1] = swing * np.sign(points[:, 1]) * np.cos(wave * points[:, 0])
    u[:, 2] = normal
    return u


def response_grid(half: float) -> np.ndarray:
    """Points of the operating shape, x slowest."""
    lines = np.linspace(-LENGTH / 2, LENGTH / 2, 41), np.linspace(-half, half, 31)
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)


def shapes(shape: DesignRecord, level_db: float) -> dict[str, np.ndarray]:
    """arrays.npz of a case."""
    points, quads = skin(shape)
    half = shape.half_span_m
    touch, touch_quads = grid(np.linspace(-LENGTH / 2, LENGTH / 2, 117), np.linspace(-half, half, 61))
    triangles = np.concatenate([touch_quads[:, [0, 1, 2]], touch_quads[:, [0, 2, 3]]])
    decay = level_db * 8
    kept = [(8, decay), (7, decay), (9, 0.5 * decay), (8, 0.0)]
    quarter = {"length": LENGTH / 2, "half": half}
    mesh, faces = box(np.zeros(3), np.array([quarter["length"], half, THICKNESS]), (40, 24, 2))
    return {
        "surface_points": points,
        "surface_quads": quads,
        "surface_u": np.stack([motion(points, *item) for item in kept]),
        "surface_frequency_hz": np.array([31500.0, 31320.0, 31810.0, 32050.0]),
        "touch_xy": touch,
        "touch_triangles": triangles,
        "touch_uz": np.stack([normal_motion(touch, *item) for item in kept]),
        "mesh_points": mesh,
        "mesh_quads": faces,
        "mesh_quality": np.linspace(0.3, 1.0, 500),
        "tet_points": mesh,
        "tet_triangles": np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]]),
        "tet_u": motion(mesh, 8, decay),
        "response_xy": response_grid(half),
        "response_uz": normal_motion(response_grid(half), 8, decay) * (1.0 + 0.1j),
        **board_arrays(),
        "cell_points": np.array(box(np.zeros(3), np.array([0.004, 0.004, THICKNESS]), (6, 6, 2))[0]),
        "cell_quads": box(np.zeros(3), np.array([0.004, 0.004, THICKNESS]), (6, 6, 2))[1],
    }


def bands(pitch: float, points: int = 25) -> BandsResult:
    """A dispersion diagram of ten synthetic bands with a gap between the sixth and the seventh."""
    corner = np.pi / pitch
    stops = [("G", 0.0, 0.0), ("X", corner, 0.0), ("M", corner, corner), ("G", 0.0, 0.0)]
    rows = []
    for (name, *start), (_, *stop) in pairwise(stops):
        for t in np.arange(points) / points:
            k = np.array(start) + t * (np.array(stop) - np.array(start))
            rows.append((name if t == 0 else None, k))
    rows.append(("G", np.zeros(2)))
    out = []
    for label, k in rows:
        s = float(np.sqrt(np.sin(k[0] * pitch / 2) ** 2 + np.sin(k[1] * pitch / 2) ** 2) / np.sqrt(2))
        low = [32.6e3 * s**0.5, 80e3 * s, 108e3 * s]
        flat = [39.7e3 - 7e3 * s * (1 - 0.1 * i) + 119e3 * s**6 * i for i in range(2)]
        upper = [108e3 + 55.1e3 * s**2, 175.84e3 + 20e3 * s, 175.84e3 + 30e3 * s, 233e3 - 10e3 * s, 260e3 + 5e3 * s]
        tones = [32541.0, 32541.0, *sorted(low + flat + upper)[2:]] if label == "M" else sorted(low + flat + upper)
        out.append(
            BandPoint(
                label=label,
                kx_per_m=k[0],
                ky_per_m=k[1],
                frequencies_hz=tones,
                computed_hz=tones,
                error=[0.003] * len(tones),
            )
        )
    gap = Gap(lower_band=6, upper_band=7, lower_hz=163100.0, upper_hz=175840.0)
    return BandsResult(model="solid", dof=20000, points=out, gaps=[gap])


def tet_bands(ours: BandsResult) -> BandsResult:
    """Bands at the labelled points from another mesh, 0.3 % higher."""
    points = [
        replace(point, frequencies_hz=[f * 1.003 for f in point.frequencies_hz])
        for point in [point for point in ours.points if point.label][:3]
    ]
    return BandsResult(model="solid", dof=30000, points=points, gaps=[])


def attenuation(rows: int) -> AttenuationResult:
    """Synthetic complex bands with a stop band around 33 kHz."""
    points = []
    for frequency in np.linspace(25e3, 45e3, 21):
        decay = max(0.0, 6.0 - abs(frequency - 33e3) / 1e3)
        wave = {"polarisation": "flexural", "ky_re_per_m": 300.0, "ky_im_per_m": decay * 28.8, "db_per_row": decay}
        steep = {"polarisation": "shear", "ky_re_per_m": 0.0, "ky_im_per_m": 200.0, "db_per_row": 7.0}
        waves = [Wave(**each, pillar_share=0.1) for each in (wave, steep)]
        transmission = Transmission(reflected=0.9, flexural=0.1, shear=0.0, longitudinal=0.0)
        points.append(
            AttenuationPoint(frequency_hz=frequency, waves=waves, db_per_row=decay, transmission=transmission)
        )
    errors = {"expected_error": None, "reduction_error": None}
    return AttenuationResult(model="solid", kx_per_m=204.0, pitch_y_m=0.004, rows=rows, points=points, **errors)


def prediction(rows: int, level_db: float | None) -> PredictionResult:
    """Synthetic transmission of the rows."""
    text = {"frequency_hz": 31500.0, "db_per_row": 4.5, "rows_db": 4.5 * rows, "transmission_db": 5.0 * rows}
    return PredictionResult(**text, zone_to_extension_db=level_db, rows_needed=3)


def peak(frequency_hz: float, level_db: float | None, zone_rms: float = 3e-8) -> PeakRecord:
    """A peak of a response."""
    passive_rms = zone_rms / 10.0 ** ((level_db or 0.0) / 20.0)
    own = {"frequency_hz": frequency_hz, "zone_rms_m_per_V": zone_rms, "passive_rms_m_per_V": passive_rms}
    return PeakRecord(**own, confinement_db=level_db, quality_factor=298.0)


def response(level_db: float | None) -> ResponseResult:
    """A synthetic resonance at 31.5 kHz with one sensor."""
    tone = np.linspace(28e3, 35e3, 141)
    motion = 3e-8 / np.abs(1.0 - (tone / 31500.0) ** 2 + 1j / 300.0) / 300.0
    heard = 1.0 / (1.0 - (tone / 31500.0) ** 2 + 1j / 300.0) / 300.0
    passive_rms = motion / 10.0 ** ((level_db or 0.0) / 20.0)
    highest = peak(tone[int(motion.argmax())], level_db, motion.max())
    return ResponseResult(
        model="solid with 8 patches",
        dof=120000,
        frequency_hz=tone.tolist(),
        zone_rms_m_per_V=motion.tolist(),
        passive_rms_m_per_V=passive_rms.tolist(),
        sensor_V_per_V=np.column_stack([heard.real, heard.imag]).tolist(),
        sensors=[7],
        polarisation_signs=[1],
        target_hz=31500.0,
        quality_factor_given=300.0,
        expected_error=None,
        circuit={"drivers": "short"},
        target_status="single",
        target_peak=highest,
        highest_peak=highest,
    )


def board() -> BoardResult:
    """A synthetic step response of an emulated board."""
    loop = {"compiler": "none", "swept": True, "frequency_hz": 31500.0, "tau_s": 3e-3, "gain": (0.0, -0.8)}
    return BoardResult(**loop, delay_s=2e-6, reference=0.16, t95_s=1.7e-3, overshoot=0.01)


def board_arrays() -> dict[str, np.ndarray]:
    """Columns of the step response: a first-order rise."""
    time = 2e-4 * np.arange(-10, 75)
    size = 0.16 * (1.0 - np.exp(-np.maximum(time, 0.0) / 0.53e-3))
    columns = {"time_s": time, "reference": 0.16 * (time >= 0.0), "u_d": size, "u_q": 0.002 * np.sin(1e4 * time)}
    return {f"board_{name}": array for name, array in {**columns, "drive": 0.2 + 0.7 * (0.16 - size)}.items()}


def mode(frequency_hz: float, **more: Any) -> ModeRecord:
    """One of the plate's modes."""
    plain = {
        "residual": 1e-11,
        "symmetry": "SS",
        "zone_share": 0.82,
        "confinement_db": 3.0,
        "mac": 0.2,
        "strength": 0.1,
    }
    return ModeRecord(frequency_hz=frequency_hz, parity="++", error=0.003, **{**plain, **more})


def count(expected: int, result: int) -> CountRecord:
    """An inertia count."""
    return CountRecord(low_hz=25e3, high_hz=45e3, expected=expected, found=result)


def target(level_db: float | None, frequency_hz: float = 31500.0, **more: Any) -> TargetMode:
    """A target mode with a given confinement."""
    rival = RivalRecord(frequency_hz=27300.0, strength=0.08, mac=0.9, confinement_db=3.0)
    own = {"status": "single", "mac": 0.93, "strength": 0.3, "zone_share": 0.82, "share": 0.7, "rivals": [rival]}
    return TargetMode(frequency_hz=frequency_hz, confinement_db=level_db, **{**own, **more})


NO_MODE = TargetRecord(status="none", frequency_hz=None, mac=None, strength=None, confinement_db=None)


def modes(one: TargetRecord, result: Sequence[ModeRecord] = (), dof: int = 120000, **more: Any) -> ModesResult:
    """The modes of a plate with its target mode."""
    about = {"model": "solid", "part": "plate", "dof": dof, "rigid_count": 6, "count_check": count(4, 4)}
    return ModesResult(**{**about, **more}, modes=list(result), target=one)


def case(case_id: str, sweep: dict[str, Any] | None = None, status: str = "OK", **sections: Any) -> StoredCase:
    """A case at hand, of any part of a record."""
    own = {"keys": keys(sections["design"])} if "design" in sections else {}
    return StoredCase(Path(case_id), Record(case_id=case_id, status=status, sweep=sweep or {}, **own | sections))


def mesh(kind: str, cells: int, dof: int) -> MeshRecord:
    """A mesh of the plate."""
    return MeshRecord(what="plate", kind=kind, order=2, cells=cells, nodes=dof // 3, dof=dof, sha256="a" * 64)


def record(case_id: str, sweep: dict[str, Any], shape: DesignRecord, level_db: float | None) -> Record:
    """A case's record."""
    confined = mode(31500.0, confinement_db=level_db, mac=0.93, strength=0.3)
    near = [mode(f) for f in (31320.0, 31810.0, 32050.0)]
    assert shape.pitch_x_m
    waves = bands(shape.pitch_x_m)
    return Record(
        case_id=case_id,
        name=case_id,
        status="OK",
        diagnosis="done",
        input_hash=hashlib.sha256(case_id.encode()).hexdigest(),
        code_hash="0" * 64,
        versions={"python": "3.11.7", "numpy": "2.4.6"},
        sweep=sweep,
        design=shape,
        keys=keys(shape),
        geometry=GeometryResult(
            files=["plate.stl", "plate.step"],
            mass_kg=0.0432,
            volume_m3=1.6e-5,
            watertight=True,
            bodies=1,
            volume_error=1e-9,
            smallest_feature="pillar",
            smallest_feature_m=0.002,
            overhang_deg=0.0,
            overhang=0.0,
        ),
        meshes=[mesh("hex", 5000, 120000), mesh("tet", 40000, 210000)],
        modes=modes(target(level_db, index=0, extension_db=level_db, pillar_energy_share=0.4), [confined, *near]),
        tet_modes=TetModesResult(
            model="solid tet2",
            dof=210000,
            frequency_hz=31520.0,
            mac=0.93,
            confinement_db=level_db,
            hex_frequency_hz=31500.0,
            hex_confinement_db=level_db,
            relative_difference=6e-4,
            count_check=count(1, 1),
        ),
        left_out=["patches: no response is requested", "mirror halves: the plate is symmetric in x and y"],
        bands=waves,
        tet_bands=tet_bands(waves),
        attenuation=attenuation(shape.rows),
        prediction=prediction(shape.rows, level_db),
        response=response(level_db),
        board=board(),
    )


def put_case(study: Path, case_id: str, sweep: dict, rows: int, pitch: float, level_db: float) -> dict:
    """Store one synthetic case."""
    shape = design(rows, pitch, 0.005)
    folder = study / case_id
    store.begin(folder, {"name": case_id, "design": {**shape.to_dict(), "material": ALUMINIUM}})
    store.save_arrays(folder, shapes(shape, level_db))
    (folder / "run.mess").write_text("--- DIAGNOSTIC JOB : OK\n")
    (folder / "plate.stl").write_bytes(b"solid")
    seconds = {"seconds": {"mesh": 2.0, "modes": 30.5, "total": 33.0}}
    store.finish(folder, record(case_id, sweep, shape, level_db).to_dict(), seconds)
    return {"case_id": case_id, "sweep": sweep}


def put_failure(study: Path, case_id: str, sweep: dict) -> dict:
    """Store a case that failed."""
    folder = study / case_id
    store.begin(folder, {"name": case_id})
    failed = Record(
        case_id=case_id, status="FAILED", sweep=sweep, diagnosis="the mesh has a cell with a negative Jacobian <7>"
    )
    store.finish(folder, failed.to_dict(), {"seconds": {}})
    return {"case_id": case_id, "sweep": sweep}


def change(folder: Path, **sections: Any) -> None:
    """Store a case's record with other parts."""
    store.seal(folder, record_of(folder).with_parts(**sections).to_dict())


def record_of(folder: Path) -> Record:
    """A case's record, read."""
    return stored.read(folder)


def put_study(study: Path, pitches: tuple[float, ...] = (0.004, 0.006), rows: tuple[int, ...] = (1, 2)) -> Path:
    """Store a synthetic study: a grid of pitch and rows, and a case that failed."""
    listed = []
    for pitch in pitches:
        for count in rows:
            sweep = {"array.pitch_mm": round(pitch * 1e3), "array.rows": count}
            name = f"pitch_mm={sweep['array.pitch_mm']},rows={count}"
            listed.append(put_case(study, name, sweep, count, pitch, 6.0 + 5.0 * count - 800 * (pitch - 0.004)))
    listed.append(put_failure(study, "pitch_mm=12,rows=1", {"array.pitch_mm": 12, "array.rows": 1}))
    about = {"name": "rows", "case": "three-rows.toml", "measure": ["modes", "confinement", "bands"]}
    store.write_sealed(study / "cases.json", {"schema": 2, "about": about, "cases": listed})
    return study
