"""Actuator-sensor shaping on any modal table."""
