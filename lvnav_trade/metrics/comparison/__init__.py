"""A candidate compared with a base, run by run. Read `comparison.py` first."""
