"""Receiver measurements on the nominal flight, and the receiver errors that all runs have in common.

Read `receiver_measurements.py` first; `solution.py` is for a receiver that computes its own solution.
"""
