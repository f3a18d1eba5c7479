"""What all metrics use: selection of series, events and phases from the tables, intervals, Gaussian probabilities.

Read `select.py` first.
"""
