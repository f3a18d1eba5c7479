"""Diagnostics of a covariance analysis.

Read `diagnostics.py` first, which calls the others.
"""
