"""Errors over time and at events: by Monte Carlo, by linear covariance, and both against each other.

Read `rms.py` and `covariances.py` first.
"""
