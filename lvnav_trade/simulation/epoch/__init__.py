"""One epoch of a filter, the same for a run and for the joint covariance.

Read `process.py` first, then `joint.py`.
"""
