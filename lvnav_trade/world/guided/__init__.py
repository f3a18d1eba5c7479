"""Ascents under guidance: a dispersed point mass that steers, and cuts off, by a state with navigation errors.

Read `reference.py` first (what guidance knows before lift-off), then `explicit.py` (the law of the last stage),
`dynamics.py` (the flight of a piece of the ascent) and `runs.py` (from draws to achieved orbits).
"""
