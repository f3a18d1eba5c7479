"""Searches over designs by linear covariance: inverse questions, sensitivity, tuning. Read `point.py` first."""
