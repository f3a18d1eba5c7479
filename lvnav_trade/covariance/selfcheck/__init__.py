"""Checks of a configuration of the user's own.

Read `case_checks.py` first, which calls the others.
"""
