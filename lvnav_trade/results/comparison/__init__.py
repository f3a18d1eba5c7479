"""A candidate compared with a base, case by case and run by run.

Read `comparison.py` first.
"""
