"""Orbital mechanics of navigation errors, independent of the results: orbits, impact points, correction impulses.

Read `mission.py` first.
"""
