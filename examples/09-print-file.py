"""A plate to print: closed surface, STEP and 3MF in millimetres, its volume and its picture."""

import pyvista

import antinode

plate = antinode.Plate(
    material="AlSi7Mg0.6",
    thickness_mm=2.0,
    zone=antinode.Zone(length_mm=40.0, width_mm=20.0, nodal_lines=3),
    pillar=antinode.Pillar(side_mm=2.0, height_mm=6.3),
    array=antinode.Array(pitch_mm=4.0, rows=2, extension_mm=8.0),
)
for kind in ("stl", "step", "3mf"):
    print(plate.export(kind, f"plate.{kind}"))
body = pyvista.read("plate.stl")
print(f"{body.volume:.0f} mm3, {body.volume * 2.67e-3:.1f} g, closed: {body.is_manifold}")

plotter = pyvista.Plotter(off_screen=True, window_size=(960, 640))
plotter.add_mesh(body, color="silver", show_edges=False)
plotter.camera_position = [(70.0, -90.0, 80.0), (0.0, 0.0, 2.0), (0.0, 0.0, 1.0)]
plotter.screenshot("print-file.png")
