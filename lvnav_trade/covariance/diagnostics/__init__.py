"""Diagnostics of a covariance analysis.

Read `case_diagnostics.py` first, which calls the others.
"""
