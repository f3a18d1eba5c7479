"""Sensors besides the IMU, one module each: truth, filter model, Jacobian rows.

`sensor.py` has their base classes, `family.py` finds them. Read `altimeter.py` as an example.
"""
