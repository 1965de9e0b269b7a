"""The steps of the command line from Python, in a script or a notebook: size, solve, look at the target mode."""

from pathlib import Path

import matplotlib.pyplot as plt

import antinode

plate = antinode.load(Path(__file__).parent / "small.toml", rows=2)
print(f"zone by plate theory: {plate.predesign().zone_hz:.0f} Hz")
modes = plate.modes()
target = modes.target
print(f"target mode: {target.frequency_hz:.0f} Hz, MAC {target.mac:.2f}, {target.confinement_db:.1f} dB")
bands = plate.bands()
print("gaps:", [(round(gap.lower_hz), round(gap.upper_hz)) for gap in bands.gaps])
figure, (left, right) = plt.subplots(1, 2, figsize=(7.0, 4.5), layout="constrained")
modes.plot(left)
plate.attenuation((20.0, 50.0)).plot(right)
figure.savefig("from-python.png", dpi=150)
