"""Seeded mutants of data files, campaigns and results: `python -m tests.fuzzing KIND COUNT [FIRST SEED]`."""
