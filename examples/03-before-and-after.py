"""The target mode of the same plate without pillars and with two rows on each side: the touch face, zone between dashes."""

import matplotlib.pyplot as plt
import numpy as np

import antinode

plate = antinode.Plate(
    thickness_mm=2.0,
    zone=antinode.Zone(length_mm=40.0, width_mm=20.0, nodal_lines=3),
    pillar=antinode.Pillar(side_mm=2.0, height_mm=6.3),
    array=antinode.Array(pitch_mm=4.0, rows=2, extension_mm=5.0),
    solve=antinode.Solve(accuracy=0.03),
)
bare = plate.with_(rows=0, extension_mm=11.0)  # two rows take 6 mm
sides = plt.figure(figsize=(7.2, 3.7), layout="constrained").subplots(1, 2, sharey=True)
for axes, each, words in zip(sides, (bare, plate), ("no pillars", "two rows on each side"), strict=True):
    modes = each.modes(symmetry=plate.case.target_symmetry)
    number = max(range(len(modes)), key=lambda i: modes[i].strength or 0.0)  # carries most of the target shape
    mode, surface = modes[number], modes.to_pyvista(number)
    face = np.abs(surface.points[:, 2]) < 1e-9
    x, y, _ = 1e3 * surface.points[face].T
    motion = surface["displacement"][face, 2]
    axes.tricontourf(x, y, motion / np.abs(motion).max(), np.linspace(-1.0, 1.0, 41), cmap="RdBu")
    for border in (-10.0, 10.0):
        axes.axhline(border, color="black", lw=0.9, ls="--")
    axes.set(aspect="equal", xlabel="x (mm)", title=f"{words}: {mode.confinement_db:.1f} dB")
    print(f"{words}: {mode.frequency_hz / 1e3:.2f} kHz, {mode.confinement_db:.1f} dB")
sides[0].set_ylabel("y (mm)")
sides[0].figure.savefig("before-and-after.png", dpi=110)
