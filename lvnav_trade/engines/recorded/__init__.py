"""Recorded logs through the filters of a case: alignment, the log in place of the simulated flight, outages."""
