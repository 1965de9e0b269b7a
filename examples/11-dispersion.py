"""A dispersion diagram: bands of a 4 mm cell with a 6.3 mm pillar on a 2 mm aluminium plate."""

import antinode

plate = antinode.Plate(
    thickness_mm=2.0,
    pillar=antinode.Pillar(shape="square", side_mm=2.0, height_mm=6.3),
    array=antinode.Array(pitch_mm=4.0),
    solve=antinode.Solve(accuracy=0.01),
)
bands = plate.bands()
print(bands, *(f"gap from {gap.lower_hz / 1e3:.1f} to {gap.upper_hz / 1e3:.1f} kHz" for gap in bands.gaps), sep="\n")
bands.as_figure().savefig("dispersion.png")
