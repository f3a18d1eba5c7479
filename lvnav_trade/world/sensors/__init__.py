"""Inertial sensors, truth side: error cards of an IMU, IMU arrays and their redundancy, Allan deviation.

Read `imu.py` first.
"""
