"""Errors of the orbit at injection, of its correction and of the impact point.

Read `orbit.py` first.
"""
