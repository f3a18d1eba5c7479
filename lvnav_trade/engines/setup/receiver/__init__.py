"""Receiver on the nominal flight: `signals.py` has its measurements, `solution.py` the solution that it computes."""
