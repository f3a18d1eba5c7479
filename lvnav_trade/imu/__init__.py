"""The inertial measurement unit: error model, IMU arrays, redundancy, Allan deviation.

Read `error_model.py` first.
"""
