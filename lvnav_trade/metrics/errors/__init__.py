"""Errors by Monte Carlo and linear covariance, and both compared. Read `rms.py` and `covariances.py` first."""
