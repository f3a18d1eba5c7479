"""Checks of a configuration of the user's own: start with `case.py`, which calls the others."""
