"""Measurements of a vehicle at rest on its pad: velocity, attitude, position, azimuth. Read `standing.py` first."""
