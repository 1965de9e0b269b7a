"""The steps of the command line from Python, in a script or a notebook: size, solve, look at the wanted mode."""

from pathlib import Path

from pipeline.analysis.bands import solve_bands
from pipeline.analysis.modes import Request, solve_modes
from pipeline.case.model import load_case
from pipeline.logs import TerminalLog
from solvers.analytic.predesign import predesign

case = load_case(Path(__file__).parent / "small.toml", ["array.rows=2"])
log = TerminalLog(quiet=True)
print(f"zone by plate theory: {predesign(case.design).to_dict()['zone']['frequency_hz']:.0f} Hz")
found = solve_modes(case, Request("plate"), log)
wanted = found.wanted.row
print(f"wanted mode: {wanted.frequency_hz:.0f} Hz, MAC {wanted.mac:.2f}, {wanted.confinement_db:.1f} dB")
bands = solve_bands(case, log)
print("gaps:", [(round(gap.lower_hz), round(gap.upper_hz)) for gap in bands.gaps])
