"""Checks of a configuration of the user's own.

Read `case.py` first, which calls the others.
"""
