"""What a receiver gives on the nominal flight, and its errors that are common to all runs.

Read `receiver_measurements.py` first; `solution.py` has a receiver that solves for itself.
"""
