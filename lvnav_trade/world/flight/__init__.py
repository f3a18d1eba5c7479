"""True trajectories of all kinds: ascents, flight in orbit and entry, sounding rockets, files of the user.

Read `trajectory.py` first: it builds the trajectory of a card.
"""
