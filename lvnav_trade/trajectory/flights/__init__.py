"""Other flights: sounding rockets, orbit and entry.

Read `free_flight.py` first.
"""
