"""A recorded log in place of a simulated flight: reading, alignment, the flight, outages.

Read `recorded_flight.py` first.
"""
