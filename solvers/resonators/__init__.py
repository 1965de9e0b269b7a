"""Resonators on beams and strips: impedance, scattering, stop bands."""
