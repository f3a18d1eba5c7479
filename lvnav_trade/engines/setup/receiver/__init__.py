"""What a receiver gives on the nominal flight: start with `signals.py`; `solution.py` has one that solves itself."""
