"""Files of a user: cases and their overrides, studies, measurements, meshes, records and mode tables."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import numpy as np

from firmware.mode_table import CRC_BYTES, Mode, ModeTable, from_bytes, seal, to_bytes
from geometry.formats.med import write_med
from geometry.formats.neutral import RawMesh
from geometry.layout import Design
from geometry.materials import MATERIALS
from geometry.pillar_shapes import SHAPES
from pipeline.batch.study_file import load_study
from pipeline.case.limits import parse_band, parse_frequency
from pipeline.case.model import load_case
from pipeline.case.schema import SIZE_KEYS
from pipeline.measured.files import read_field, read_sweep
from pipeline.planning.model_choice import cell_model_choice
from pipeline.questions.predesign import sized
from pipeline.records import record, store
from tests.fuzz.damage import KEYS, ODD, damaged, of_document, of_value, renumbered
from tests.geometry.formats import test_inp, test_msh
from tests.geometry.formats.test_mutants import mutant
from tests.helpers import synthetic
from tests.helpers.mesh_files import load
from tests.pipeline.measured.test_universal import written

STUDIES = Path(__file__).parents[2] / "studies"
CASE, STUDY = ((STUDIES / name).read_text() for name in ("three-rows.toml", "rows.toml"))
SIZES = [
    key for key in KEYS if key.endswith(("_mm", "young_GPa", "kg_m3", "quality_factor", "near_kHz")) and "." in key
]
QUANTITIES = ["30", "31.5", "4e1", "0", "1e308", "1e-308", "-1", "nan", "inf", "", ":", "3e999", "1e-9", "٣", "30:34"]
DESIGN = Design(60e-3, 20e-3, 2e-3, 4, MATERIALS["aluminium"], None, float("nan"), float("nan"), 0, 12e-3)
SWEEP = "# a note\nfrequency_Hz,amplitude_m_per_s,phase_deg\n" + "".join(
    f"{30e3 + i},{1 + i},{10 * i}\n" for i in range(12)
)
FIELD = "x_mm,y_mm,real,imag\n" + "".join(f"{i - 6},{i},{i * 1e-3},0\n" for i in range(12))
MESHES = {
    "22.msh": test_msh.text_22(),
    "22b.msh": test_msh.binary_22(),
    "41.msh": test_msh.text_41(),
    "41b.msh": test_msh.binary_41(),
    "body.inp": test_inp.PLAIN.encode(),
}
TABLE = to_bytes(ModeTable(250e3, bytes(16), (Mode(31250.0, 3e-3), Mode(35000.0, 2e-3))))


class Files:
    """Makers and readers of each kind of file, in one folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        nodes = np.vstack([np.zeros(3), np.eye(3), np.ones(3)])
        block = ("tetra", np.array([[0, 1, 2, 3], [1, 2, 3, 4]]))
        write_med(
            RawMesh(nodes, [block], {"A": {0: np.array([0])}}, {"N": np.array([0, 1])}), folder / "whole.med", "M"
        )
        self.med = (folder / "whole.med").read_bytes()
        self.universal_text = Path(written(folder / "whole.uff", [[3]] * 6)).read_bytes()
        (folder / "three-rows.toml").write_text(CASE)
        synthetic.put_study(folder / "rows", (0.004,), (1,))
        self.case_folder = folder / "rows" / "pitch_mm=4,rows=1"
        self.record_whole = json.loads((self.case_folder / store.RECORD).read_text())

    def write(self, name: str, content: bytes) -> str:
        path = self.folder / name
        path.write_bytes(content)
        return str(path)

    # overrides of a case, as a JSON list of texts

    def draw_override(self, draw: random.Random) -> bytes:
        if draw.random() < 0.4:
            text = damaged(f"{draw.choice(KEYS)}={draw.choice(ODD)}".encode(), draw).decode("latin-1")
            return json.dumps([text]).encode()
        if draw.random() < 0.3:
            return json.dumps([f"{draw.choice(SIZES)}={draw.uniform(0.5, 50.0)!r}"]).encode()
        return json.dumps([f"{draw.choice(KEYS)}={draw.choice(ODD)}" for _ in range(draw.randint(1, 3))]).encode()

    def read_override(self, data: bytes) -> Any:
        return load_case(self.folder / "three-rows.toml", json.loads(data))

    def draw_shape(self, draw: random.Random) -> bytes:
        """A pillar's shape with its own sizes, each ordinary or of any magnitude, now and then one of another shape."""
        shape = SHAPES[draw.choice([*SHAPES])]
        keys = {*shape.keys, draw.choice([*shape.keys, *SIZE_KEYS, "height_mm", "fillet_mm"])}
        sizes = {key: draw.choice((draw.uniform(0.3, 3.0), 10.0 ** draw.uniform(-4.0, 5.0))) for key in sorted(keys)}
        return json.dumps([f"pillar.shape={shape.name}", *(f"pillar.{k}={v!r}" for k, v in sizes.items())]).encode()

    def read_shape(self, data: bytes) -> Any:
        return cell_model_choice(self.read_override(data))

    def draw_number(self, draw: random.Random) -> bytes:
        """One number of the plate between the odd and the ordinary."""
        return json.dumps([f"{draw.choice(SIZES)}={10.0 ** draw.uniform(-4.0, 5.0)!r}"]).encode()

    def read_number(self, data: bytes) -> Any:
        """Its pre-design, as JSON without infinities."""
        return json.dumps(sized(self.read_override(data).design).values(), allow_nan=False)

    # files

    def draw_case(self, draw: random.Random) -> bytes:
        return of_value(CASE, draw) if draw.random() < 0.4 else damaged(CASE.encode(), draw)

    def read_case(self, data: bytes) -> Any:
        return load_case(self.write("damaged.toml", data))

    def draw_study(self, draw: random.Random) -> bytes:
        return of_value(STUDY, draw) if draw.random() < 0.5 else damaged(STUDY.encode(), draw)

    def read_study(self, data: bytes) -> Any:
        return load_study(self.write("study.toml", data))

    def draw_quantity(self, draw: random.Random) -> bytes:
        ends = [draw.choice(QUANTITIES) + draw.choice(["", "Hz", "kHz", "MHz", "k"]) for _ in range(2)]
        return (":".join(ends) if draw.random() < 0.5 else ends[0]).encode()

    def read_quantity(self, data: bytes) -> Any:
        text = data.decode()
        return parse_band(text, "--band") if ":" in text else parse_frequency(text, "--near")

    def draw_sweep(self, draw: random.Random) -> bytes:
        return renumbered(SWEEP, draw) if draw.random() < 0.6 else damaged(SWEEP.encode(), draw)

    def read_sweep(self, data: bytes) -> Any:
        return read_sweep(self.write("sweep.csv", data))

    def draw_field(self, draw: random.Random) -> bytes:
        return renumbered(FIELD, draw) if draw.random() < 0.6 else damaged(FIELD.encode(), draw)

    def read_field(self, data: bytes) -> Any:
        return read_field(self.write("field.csv", data), DESIGN)

    def draw_universal(self, draw: random.Random) -> bytes:
        return mutant(self.universal_text, draw)

    def read_universal(self, data: bytes) -> Any:
        path = self.write("map.uff", data)
        return read_sweep(path), read_field(path, DESIGN)

    def draw_mesh(self, draw: random.Random) -> bytes:
        """The name of a format's file, a line end, and its content."""
        name = draw.choice([*MESHES])
        text = MESHES[name]
        odd = b"b." not in name.encode() and draw.random() < 0.4
        return name.encode() + b"\n" + (renumbered(text.decode(), draw) if odd else mutant(text, draw))

    def read_mesh(self, data: bytes) -> Any:
        name, _, content = data.partition(b"\n")
        return load(self.write(name.decode(), content))

    def draw_med(self, draw: random.Random) -> bytes:
        data = bytearray(self.med)
        for _ in range(draw.randint(1, 20)):
            data[draw.randrange(len(data))] = draw.choice((0, 255, draw.randrange(256)))
        return bytes(data)

    def read_med(self, data: bytes) -> Any:
        return load(self.write("m.med", data))

    def draw_record_file(self, draw: random.Random) -> bytes:
        return damaged(json.dumps(self.record_whole).encode(), draw)

    def read_record_file(self, data: bytes) -> Any:
        (self.case_folder / store.RECORD).write_bytes(data)
        return record.read(self.case_folder)

    def draw_record(self, draw: random.Random) -> bytes:
        """A record of other content with a true checksum, as a script or another version may write it."""
        return json.dumps(of_document(self.record_whole, draw)).encode()

    def read_record(self, data: bytes) -> Any:
        document = json.loads(data)
        if not isinstance(document, dict):
            document = {"case_id": document}
        document.pop(store.PROOF, None)
        proof = store._proof(document, store.read_json(self.case_folder / store.MANIFEST))
        (self.case_folder / store.RECORD).write_text(json.dumps({**document, store.PROOF: proof}))
        return record.read(self.case_folder).to_dict()

    def draw_table(self, draw: random.Random) -> bytes:
        """A mode table whose checksum is that of its damaged body."""
        body = bytearray(TABLE[:-CRC_BYTES])
        for _ in range(draw.randint(1, 4)):
            body[draw.randrange(len(body))] = draw.choice((0, 255, 0x7F, 0x80, draw.randrange(256)))
        return seal(bytes(body)) if draw.random() < 0.9 else damaged(TABLE, draw)

    def read_table(self, data: bytes) -> Any:
        return to_bytes(from_bytes(data))
