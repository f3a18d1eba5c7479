"""Sensors other than the GNSS receiver: error cards of the IMU, the radar altimeter and the attitude reference.

Read `imu.py` first.
"""
