"""Families of metrics, one in each module: name, unit, meaning, needs, value three times.

``METRICS`` of a module names its members; the registry finds them. Read `state_errors.py` first.
"""
