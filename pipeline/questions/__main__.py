"""Write index.json, from which `antinode --help` lists the questions."""

from __future__ import annotations

import json

from pipeline.questions import INDEX, index
from pipeline.records.store import write_atomic

if __name__ == "__main__":
    write_atomic(INDEX, (json.dumps(index(), indent=1, ensure_ascii=False) + "\n").encode())
