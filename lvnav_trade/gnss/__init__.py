"""Satellites, their signals and the receiver, truth side; atmospheric delays; faults of satellites, receiver and IMU.

Read `receiver_cards.py` first, then `visibility.py`; for positions of satellites `satellites.py`.
"""
