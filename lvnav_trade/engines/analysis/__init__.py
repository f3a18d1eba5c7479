"""Diagnostics of a covariance analysis: start with `explain.py`, which calls the others."""
