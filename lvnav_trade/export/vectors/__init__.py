"""Reference vectors of a filter: inputs and outputs of one run, epoch by epoch. Read `vector_tables.py` first."""
