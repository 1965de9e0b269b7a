"""Where the patches' power goes: lost in the plate, taken by the finger, lost in the ceramic's dielectric.

Power in = Re(V* I)/2 with I = j omega (theta' u + C V) summed over the patches. Only the modes are damped: the plate loses
omega/(2 Q) sum lambda_r |q_r|^2, the finger takes Re(Z) omega^2 mean |u|^2/2.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from solvers.touch.touched_plate import TouchedPlate, rms


@dataclass(frozen=True)
class Power:
    """Means over a period, W per V^2 of drive: power in without dielectric losses, and where it ends.

    dielectric_w: None where the ceramic's tan delta is unknown. apparent_va: sum of |V| |I|/2 over the patches.
    finger_m: rms over the contact of the peak amplitude, m/V.
    """

    patches_w: float
    plate_w: float
    finger_w: float
    dielectric_w: float | None
    apparent_va: float
    finger_m: float

    @property
    def drawn_w(self) -> float | None:
        """What a supply gives that gets reactive power back."""
        return None if self.dielectric_w is None else self.patches_w + self.dielectric_w


def power(touched: TouchedPlate, frequency_hz: float, loss_tangent: float | None) -> Power:
    """The balance at a frequency, per volt of drive squared."""
    plate, count, omega = touched.plate, len(touched.plate.patches), 2.0 * pi * frequency_hz
    eigenvalue = plate.scale.eigenvalue(frequency_hz)
    loads = touched.volts(eigenvalue)
    volts, answer = loads[:count], touched.receptance(eigenvalue) @ loads
    current = 1j * omega * (answer[:count] + plate.capacitance_f * volts)
    modal = 0.0
    for basis in touched.modes:
        q = (basis.gain @ loads) / (basis.eigenvalue * (1.0 + 1j * touched.loss) - eigenvalue)
        modal += float(basis.eigenvalue @ np.abs(q) ** 2)
    finger = touched.finger
    amplitude = rms(touched.contact_motion(frequency_hz))
    return Power(
        patches_w=0.5 * float((volts.conj() @ current).real),
        plate_w=0.5 * omega * touched.loss * plate.stiffness_unit * modal,
        finger_w=0.5 * finger.tip.resistance_n_s_m(finger.area_m2) * (omega * amplitude) ** 2,
        dielectric_w=None
        if loss_tangent is None
        else 0.5 * omega * loss_tangent * float(plate.capacitance_f @ np.abs(volts) ** 2),
        apparent_va=0.5 * float(np.abs(volts) @ np.abs(current)),
        finger_m=amplitude,
    )
