"""Orbital mechanics of navigation errors: orbits, free fall and impact points, correction impulses.

Read `mission_errors.py` first.
"""
