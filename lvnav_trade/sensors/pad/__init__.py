"""Sensors of a vehicle that stands on its pad."""
