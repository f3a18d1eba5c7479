"""Requirements: verdicts by Monte Carlo, by linear covariance, and which error sources must improve to meet them.

Read `requirements.py` first.
"""
