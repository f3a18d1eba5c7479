"""What all metrics use: selection from the tables, intervals, Gaussian probabilities. Read `select.py` first."""
