"""Plates whose pillars differ one by one."""
