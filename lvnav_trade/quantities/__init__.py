"""Numbers and their meaning: units of measure, axes, frames, states, records of several rooms, input errors.

Read `units.py` and `state_layout.py` first.
"""
