"""Files of the user: trajectories, recorded logs of an IMU and a receiver, and recorded receiver errors.

Read `columns.py` first (the card), then `table.py`.
"""
