"""Powered ascents, solved for a vehicle card and a target orbit, or rebuilt from a record of speed and altitude.

Read `vehicle_cards.py` first (the cards), then `launch.py` (a solved ascent as true trajectory) and `profile.py` (a
rebuilt one).
"""
