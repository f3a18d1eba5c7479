"""Reference vectors of a filter: inputs and expected outputs of one run, epoch by epoch. Read `tables.py` first."""
