"""Errors of the orbit at injection, of its correction and of the impact point, by linear covariance and by the runs.

Read `orbit.py` first.
"""
