"""Trajectories from the user's files: from columns of numbers to a true trajectory.

Read `columns.py` first (the card), then `table_flight.py`.
"""
