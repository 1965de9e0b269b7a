"""Amplitude control of one mode in the rotating frame, as the firmware does it: 95 % within two milliseconds."""

import antinode

plate = antinode.Plate(
    thickness_mm=2.0,
    zone=antinode.Zone(length_mm=56.0, width_mm=20.0, nodal_lines=4),
    pillar=antinode.Pillar(side_mm=2.0, height_mm=6.3),
    array=antinode.Array(pitch_mm=4.0),
)
loop = plate.active_dq(settling_time_s=2e-3)
print(f"time constant without control: {1e3 * loop.plant['tau_s']:.2f} ms, stable: {loop.margins['stable']}")
loop.pictures()[0].figure.savefig("amplitude-loop.png")  # the step response
