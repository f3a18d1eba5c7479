"""What is known of a vehicle that stands on its pad: velocity, attitude, position, azimuth. `standing.py` first."""
