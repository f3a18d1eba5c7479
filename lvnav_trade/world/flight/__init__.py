"""True trajectories of every kind: ascents, flight in orbit and entry, sounding rockets, files of the user's own.

Read `trajectory.py` first: it builds the trajectory that a card asks for.
"""
