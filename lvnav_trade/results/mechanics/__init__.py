"""Orbital mechanics of navigation errors: orbits, impact points, correction impulses.

Read `mission_errors.py` first.
"""
