"""The inertial measurement unit: error model, arrays of several, redundancy, Allan deviation.

Read `error_model.py` first.
"""
