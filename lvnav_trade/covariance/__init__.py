"""Linear covariance over the nominal flight: formal, true, by source, forwards and backwards.

Read `history.py` first.
"""
