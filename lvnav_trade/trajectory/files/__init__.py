"""Trajectories from files of the user's own: columns of numbers to a true flight.

Read `columns.py` first (the card), then `table_flight.py`.
"""
