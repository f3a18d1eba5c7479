"""Sensors of a vehicle at rest on its pad."""
