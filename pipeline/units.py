"""Units of files, figures and prose: a figure times its unit is in SI, a value in SI over a unit is the figure to show."""

from __future__ import annotations

from math import pi

CM, MM, UM, NM = 1e-2, 1e-3, 1e-6, 1e-9  # m
MS, US = 1e-3, 1e-6  # s
KHZ = 1e3
GPA = 1e9
GRAM = 1e-3  # kg
GIB = 2.0**30  # bytes
DEGREE = pi / 180.0  # rad
