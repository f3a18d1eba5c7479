"""Searches over designs by linear covariance: inverse problems, sensitivity, tuning. Read `point.py` first."""
