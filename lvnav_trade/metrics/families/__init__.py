"""Families of metrics, one in a module: ``METRICS`` names its members. Read `errors.py` first."""
