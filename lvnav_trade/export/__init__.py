"""The filter of a case as C99, and the runs that it is replayed on. Read `code.py` first."""
