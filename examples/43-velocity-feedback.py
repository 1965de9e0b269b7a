"""Active confinement on a strip: velocity feedback on both sides of its centre, point forces and patches."""

import antinode

plate = antinode.Plate(
    thickness_mm=2.0,
    zone=antinode.Zone(length_mm=56.0, width_mm=20.0, nodal_lines=4),
    pillar=antinode.Pillar(side_mm=2.0, height_mm=6.3),
    array=antinode.Array(pitch_mm=4.0),
)
loops = plate.active_beam(frequency_kHz=(3.0,), gain_N_per_m=(1e7, 1e8))
print(f"first resonance of the strip: {loops.beam['natural_hz'][0]:.1f} Hz")
loops.plot().figure.savefig("velocity-feedback.png")
