"""The true world: trajectories, satellites, the receiver, and the errors and faults of sensors.

Folders: `ascent`, `flight` and `user_file` (trajectories), `sky` (satellites), `receiver`, `sensors`, and `control`
(the vehicle under attitude control). `truth.py` is common to all trajectories; read it first.
"""
