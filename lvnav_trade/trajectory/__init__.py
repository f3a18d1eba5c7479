"""The true flight: splines, disturbances, and where a trajectory comes from.

Read `truth.py` first, then `flight.py`.
"""
